//! Products of functions, for merging maps and for clusters of objects with a map each (LV00,
//! section 3.2).

use super::{Curve, LEAST_CHORD_TOLERANCE, step_by};

impl Curve {
    /// Writes the product of two functions to `out`: the light that passes both, `out = a b`.
    ///
    /// `out` has the depths of both functions, bit exact. Where both fall, the product is
    /// quadratic. There it gets more f32 depths, at most `1 / (2 sqrt(chord_tolerance))` in all, so
    /// that it differs from its chords by at most `chord_tolerance` at any f32 depth. A tolerance
    /// below 1e-9 counts as 1e-9. The error of `out` is `ea + eb + chord`: for values from 0 to 1,
    /// `|a b - a' b'| <= |a - a'| b + a' |b - b'|`. A mono function applies to all channels of a
    /// coloured one. Multiply more than two functions one after the other, each with its share of
    /// the tolerance. Cost: (n + m) log(n + m).
    ///
    /// ```
    /// use deepshadow::Curve;
    /// let fog = Curve::mono(vec![0.0, 4.0], vec![1.0, 0.5]).unwrap();
    /// let pane = Curve::mono(vec![2.0], vec![0.5]).unwrap();
    /// let mut both = Curve::default();
    /// fog.product(&pane, 0.01, &mut both);
    /// assert_eq!((both.visibility(2.0), both.visibility_behind(2.0)), (0.75, 0.375));
    /// assert_eq!(both.end(), 0.25);
    /// ```
    pub fn product(&self, other: &Curve, chord_tolerance: f64, out: &mut Curve) {
        match self.channels().max(other.channels()) {
            1 => product_channels::<1>(self, other, chord_tolerance, out),
            _ => product_channels::<3>(self, other, chord_tolerance, out),
        }
        out.vertices.merge_equal_channels();
    }
}

fn product_channels<const C: usize>(a: &Curve, b: &Curve, chord_tolerance: f64, out: &mut Curve) {
    out.reset(C);
    let tolerance = chord_tolerance.max(LEAST_CHORD_TOLERANCE);
    let mut depths: Vec<f32> = [a.depths(), b.depths()].concat();
    depths.sort_unstable_by(f32::total_cmp);
    depths.dedup();
    let mut error: f64 = 0.0;
    // Values of both functions just behind the previous depth, and of their product. `lower` keeps
    // the product from rising by rounding.
    let (mut last_a, mut last_b, mut v) = ([1.0; C], [1.0; C], [1.0; C]);
    let lower = |v: [f64; C], a: [f64; C], b: [f64; C]| -> [f64; C] {
        std::array::from_fn(|c| v[c].min(a[c] * b[c]))
    };
    for (i, &z) in depths.iter().enumerate() {
        let [at_a, at_b] = [a, b].map(|f| f.function().evaluate::<C>(z, false));
        if i > 0 {
            let front = depths[i - 1];
            let run = f64::from(z) - f64::from(front);
            let falls = (0..C).map(|c| (at_a[c] - last_a[c]) * (at_b[c] - last_b[c]));
            let quarter = falls.fold(0.0, f64::max) / 4.0;
            // The chord error over a length h is `quarter * (h / run)^2`.
            let h = run * (tolerance / quarter).sqrt();
            let mut near = front;
            while near < z {
                let far = step_by(near, h, z);
                if far > near.next_up() {
                    let part = (f64::from(far) - f64::from(near)) / run;
                    error = error.max(quarter * part * part);
                }
                near = far;
                if near < z {
                    let t = (f64::from(near) - f64::from(front)) / run;
                    let on = |s: &[f64; C], e: &[f64; C]| {
                        std::array::from_fn(|c| s[c] + (e[c] - s[c]) * t)
                    };
                    v = lower(v, on(&last_a, &at_a), on(&last_b, &at_b));
                    out.push_unchecked(near, &v);
                }
            }
        }
        let front = lower(v, at_a, at_b);
        [last_a, last_b] = [a, b].map(|f| f.function().evaluate::<C>(z, true));
        v = lower(front, last_a, last_b);
        out.push_depth(z, &front, &v);
        if v == [0.0; C] {
            break;
        }
    }
    out.error = a.error + b.error + error;
}
