//! Opacity over a surface: a picture, looked up by texture coordinate.

/// A picture of opacities, repeated in both directions; (0, 0) is its lower left corner, (1, 1) its upper right one.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// Row by row from the top: red, green and blue, 0 to 1.
    pub values: Vec<[f32; 3]>,
}

impl Texture {
    /// Bilinear between the centres of its pixels.
    pub fn at(&self, [u, v]: [f32; 2]) -> [f32; 3] {
        let place = |t: f32, n: u32| {
            let x = (t - t.floor()) * n as f32 - 0.5;
            let low = x.floor();
            let wrap = |i: i64| i.rem_euclid(i64::from(n)) as usize;
            (wrap(low as i64), wrap(low as i64 + 1), x - low)
        };
        let (x0, x1, fx) = place(u, self.width);
        let (y0, y1, fy) = place(1.0 - v, self.height);
        let row = |y: usize| y * self.width as usize;
        let (top, bottom) = (row(y0), row(y1));
        std::array::from_fn(|c| {
            let mix =
                |row: usize| self.values[row + x0][c] * (1.0 - fx) + self.values[row + x1][c] * fx;
            (mix(top) * (1.0 - fy) + mix(bottom) * fy).clamp(0.0, 1.0)
        })
    }

    /// Whether red, green and blue differ anywhere.
    pub fn is_coloured(&self) -> bool {
        self.values.iter().any(|[r, g, b]| r != g || g != b)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_texture_is_its_pixels_at_their_centres_and_repeats() {
        let grey = |v: f32| [v; 3];
        let texture = Texture {
            width: 2,
            height: 2,
            values: vec![grey(0.0), grey(0.25), grey(0.5), grey(1.0)],
        };
        for shift in [0.0, 1.0, -3.0] {
            assert_eq!(texture.at([0.25 + shift, 0.75]), grey(0.0));
            assert_eq!(texture.at([0.75, 0.25 + shift]), grey(1.0));
        }
        assert_eq!(texture.at([0.5, 0.75]), grey(0.125));
        assert_eq!(texture.at([0.0, 0.75]), grey(0.125)); // the other side
    }
}
