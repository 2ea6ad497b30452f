//! Depths and opacities from the channels of a pixel.

use crate::block::DeepBlock;
use crate::error::{Error, Place, Result};
use crate::header::{Channel, Part};
use std::fmt;

/// One sample of a deep pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeepSample {
    /// Depth of the front; finite.
    pub z: f32,
    /// Depth of the back; equal to `z` for a surface, larger for a volume.
    pub z_back: f32,
    /// Fraction of red, green and blue light that the sample blocks, from 0 to 1.
    pub opacity: [f32; 3],
}

/// The treatment of invalid samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Policy {
    /// Repair or drop them, and count them.
    #[default]
    Repair,
    /// Fail at the first one, with its pixel and index.
    Strict,
}

/// Counts of repaired and dropped samples; `Display` prints one line.
///
/// ```
/// use deepshadow_exr::samples::Repairs;
/// let mut all = Repairs { nan: 2, ..Repairs::default() };
/// all.add(&Repairs { opacity: 1, ..Repairs::default() });
/// assert_eq!(all.total(), 3);
/// assert_eq!(all.to_string(), "2 samples dropped (not a number), 1 opacity clamped to 0..1");
/// assert_eq!(Repairs::default().to_string(), "no repairs");
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Repairs {
    /// Samples dropped because a depth or an opacity is NaN.
    pub nan: u64,
    /// Samples dropped because a depth is infinite.
    pub infinite: u64,
    /// Samples whose opacity was clamped to 0 to 1.
    pub opacity: u64,
    /// Samples whose `ZBack` was in front of `Z` and was moved to `Z`.
    pub z_back: u64,
}

impl Repairs {
    /// Number of repairs; a sample repaired twice counts twice.
    pub fn total(&self) -> u64 {
        self.nan + self.infinite + self.opacity + self.z_back
    }

    /// Adds the counts of `other`.
    pub fn add(&mut self, other: &Repairs) {
        self.nan += other.nan;
        self.infinite += other.infinite;
        self.opacity += other.opacity;
        self.z_back += other.z_back;
    }
}

impl fmt::Display for Repairs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.total() == 0 {
            return f.write_str("no repairs");
        }
        let mut sep = "";
        for (count, singular, plural, repair) in [
            (self.nan, "sample", "samples", "dropped (not a number)"),
            (
                self.infinite,
                "sample",
                "samples",
                "dropped (infinite depth)",
            ),
            (self.opacity, "opacity", "opacities", "clamped to 0..1"),
            (self.z_back, "ZBack", "ZBacks", "moved back to Z"),
        ] {
            if count > 0 {
                let noun = if count == 1 { singular } else { plural };
                write!(f, "{sep}{count} {noun} {repair}")?;
                sep = ", ";
            }
        }
        Ok(())
    }
}

/// The source of a sample's opacity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Opacity {
    Opaque,
    Channels([usize; 3]),
}

/// The channels of a part that hold depth and opacity.
///
/// Depth is in `Z` and `ZBack`. Opacity is in `AR`, `AG`, `AB`, or else in `RA`, `GA`, `BA`, with
/// `A` in place of a missing one, or else in `A` alone. Without any of these, samples are opaque.
///
/// ```
/// use deepshadow_exr::{Channel, SampleType::*, samples::SampleChannels};
/// let names = ["smoke.A", "smoke.Z"].map(|n| Channel::new(n, Half));
/// let found = SampleChannels::resolve(&names, None).unwrap();
/// assert_eq!(found.layer(), "smoke");
/// assert!(!found.is_coloured() && !found.is_opaque());
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SampleChannels {
    layer: String,
    z: usize,
    z_back: Option<usize>,
    opacity: Opacity,
    /// Whether an infinite depth means an empty pixel, as in flat images.
    infinite_is_empty: bool,
}

impl SampleChannels {
    /// Finds the channels of `part`. In flat parts, an infinite depth means an empty pixel.
    ///
    /// # Errors
    /// As for [`SampleChannels::resolve`].
    pub fn of(part: &Part, layer: Option<&str>) -> Result<Self> {
        let found = Self::resolve(&part.channels, layer)?;
        Ok(SampleChannels {
            infinite_is_empty: !part.deep,
            ..found
        })
    }

    /// Finds the channels of `layer`; `None` means the channels without a prefix, or else the only
    /// layer with a `Z`.
    ///
    /// # Errors
    /// `Input` if there is no `Z`, or if `layer` is `None` and several layers have a `Z`;
    /// `Unsupported` if only some colours have an opacity.
    pub fn resolve(channels: &[Channel], layer: Option<&str>) -> Result<Self> {
        let layer = match layer {
            Some(layer) => layer.to_owned(),
            None => default_layer(channels)?,
        };
        let find = |name: &str| {
            channels.iter().position(|c| {
                if layer.is_empty() {
                    return c.name == name;
                }
                let rest = c.name.strip_prefix(layer.as_str());
                rest.and_then(|r| r.strip_prefix('.')) == Some(name)
            })
        };
        let z = find("Z").ok_or_else(|| {
            let names: Vec<&str> = channels.iter().take(20).map(|c| c.name.as_str()).collect();
            let in_layer = match layer.as_str() {
                "" => String::new(),
                layer => format!(" in layer {layer:?}"),
            };
            Error::input(format!(
                "there is no Z{in_layer} among the channels {}",
                names.join(", ")
            ))
        })?;
        let grey = find("A");
        let mut opacity = match grey {
            Some(a) => Opacity::Channels([a; 3]),
            None => Opacity::Opaque,
        };
        for names in [["AR", "AG", "AB"], ["RA", "GA", "BA"]] {
            let found = names.map(find);
            if found.iter().all(Option::is_none) {
                continue;
            }
            let [Some(r), Some(g), Some(b)] = found.map(|c| c.or(grey)) else {
                return Err(Error::unsupported(format!(
                    "some of {} are missing, and there is no A",
                    names.join(", ")
                )));
            };
            opacity = Opacity::Channels([r, g, b]);
            break;
        }
        Ok(SampleChannels {
            z,
            z_back: find("ZBack"),
            opacity,
            infinite_is_empty: false,
            layer,
        })
    }

    /// Name of the layer; empty for channels without a prefix.
    pub fn layer(&self) -> &str {
        &self.layer
    }

    /// Whether there is no opacity channel, so that all samples are opaque.
    pub fn is_opaque(&self) -> bool {
        self.opacity == Opacity::Opaque
    }

    /// Whether red, green and blue have different opacity channels.
    pub fn is_coloured(&self) -> bool {
        matches!(self.opacity, Opacity::Channels([r, g, b]) if r != g || r != b)
    }

    /// Whether samples may have thickness.
    pub fn has_z_back(&self) -> bool {
        self.z_back.is_some()
    }

    /// Replaces the contents of `out` with the samples of pixel `p`, in the file's order.
    ///
    /// `p` counts row by row. Samples may overlap and need not be sorted. [`Policy::Repair`] drops
    /// samples with a NaN or an infinite depth, clamps opacities to 0 to 1, and moves a `ZBack` in
    /// front of `Z` to `Z`. It counts these repairs in `repairs`. Samples of opacity 0 are dropped
    /// and not counted. The cost is that of copying the samples.
    ///
    /// # Errors
    /// `Input` if the block lacks pixel `p` or these channels; with [`Policy::Strict`], `Input` for
    /// the first sample that would need a repair.
    pub fn pixel(
        &self,
        block: &DeepBlock,
        p: usize,
        policy: Policy,
        repairs: &mut Repairs,
        out: &mut Vec<DeepSample>,
    ) -> Result<()> {
        out.clear();
        let Some(range) = block.pixel(p).filter(|_| self.has_channels(block)) else {
            return Err(Error::input("the block has no such pixel or channels"));
        };
        let get = |channel: usize, i: usize| block.channels[channel].get(i);
        for (number, i) in range.enumerate() {
            let check_policy = |subject: &str, value: f32| {
                if policy == Policy::Repair {
                    return Ok(());
                }
                let width = block.rect.width.max(1) as usize;
                let x = block.rect.x.wrapping_add((p % width) as i32);
                let y = block.rect.y.wrapping_add((p / width) as i32);
                Err(Error::input(format!("{subject} is {value}")).at(Place {
                    pixel: Some((x, y)),
                    sample: Some(number),
                    ..Place::default()
                }))
            };
            let z = get(self.z, i);
            let mut z_back = self.z_back.map_or(z, |c| get(c, i));
            let mut opacity = match self.opacity {
                Opacity::Opaque => [1.0; 3],
                Opacity::Channels(c) => c.map(|c| get(c, i)),
            };
            if opacity == [0.0; 3] {
                continue; // blocks no light
            }
            let nan = [("Z", z), ("ZBack", z_back)].into_iter();
            let nan = nan.chain(opacity.map(|a| ("opacity", a)));
            if let Some((subject, value)) = nan.into_iter().find(|(_, v)| v.is_nan()) {
                check_policy(subject, value)?;
                repairs.nan += 1;
                continue;
            }
            if z.is_infinite() || z_back.is_infinite() {
                if !self.infinite_is_empty {
                    if z.is_infinite() {
                        check_policy("Z", z)?;
                    }
                    check_policy("ZBack", z_back)?;
                    repairs.infinite += 1;
                }
                continue;
            }
            if let Some(&a) = opacity.iter().find(|a| !(0.0..=1.0).contains(*a)) {
                check_policy("opacity", a)?;
                repairs.opacity += 1;
                opacity = opacity.map(|a| a.clamp(0.0, 1.0));
            }
            if z_back < z {
                check_policy(&format!("ZBack before Z {z}: it"), z_back)?;
                repairs.z_back += 1;
                z_back = z;
            }
            if opacity != [0.0; 3] {
                out.push(DeepSample { z, z_back, opacity });
            }
        }
        Ok(())
    }

    /// Whether `block` has all of these channels.
    fn has_channels(&self, block: &DeepBlock) -> bool {
        let last = |c: &[usize]| c.iter().copied().max().unwrap_or(0);
        let highest = match self.opacity {
            Opacity::Opaque => 0,
            Opacity::Channels(c) => last(&c),
        };
        last(&[self.z, self.z_back.unwrap_or(0), highest]) < block.channels.len()
    }
}

/// The empty layer if it has a `Z`, or else the only layer that has one.
fn default_layer(channels: &[Channel]) -> Result<String> {
    if channels.iter().any(|c| c.name == "Z") {
        return Ok(String::new());
    }
    let mut layers = channels.iter().filter_map(|c| c.name.strip_suffix(".Z"));
    match (layers.next(), layers.next()) {
        (None, _) => Ok(String::new()),
        (Some(only), None) => Ok(only.to_owned()),
        (Some(a), Some(b)) => Err(Error::input(format!(
            "several layers have a Z, such as {a:?} and {b:?}: choose one"
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::block::ChannelData::Float;
    use crate::header::{Rect, SampleType};

    fn channels(names: &[&str]) -> Vec<Channel> {
        names
            .iter()
            .map(|&n| Channel::new(n, SampleType::Float))
            .collect()
    }

    fn one_pixel(columns: &[&[f32]]) -> DeepBlock {
        DeepBlock {
            rect: Rect {
                x: 5,
                y: -6,
                width: 1,
                height: 1,
            },
            offsets: vec![0, columns[0].len() as u32],
            channels: columns.iter().map(|c| Float(c.to_vec())).collect(),
        }
    }

    const NAN: f32 = f32::NAN;
    const INF: f32 = f32::INFINITY;

    #[test]
    fn invalid_samples_are_repaired_or_dropped_and_counted() {
        let found = SampleChannels::resolve(&channels(&["A", "Z", "ZBack"]), None).unwrap();
        let block = one_pixel(&[
            &[0.5, NAN, 0.5, 0.5, 1.5, -0.5, 0.5, 0.0, 0.25, INF],
            &[2.0, 1.0, NAN, INF, 1.0, 1.0, 4.0, NAN, 1.0, 6.0],
            &[2.0, 1.0, 1.0, INF, 2.0, 1.0, 3.0, 1.0, INF, 6.0],
        ]);
        let mut repairs = Repairs::default();
        let mut out = Vec::new();
        found
            .pixel(&block, 0, Policy::Repair, &mut repairs, &mut out)
            .unwrap();
        let sample = |z, z_back, a| DeepSample {
            z,
            z_back,
            opacity: [a; 3],
        };
        assert_eq!(
            out,
            [
                sample(2.0, 2.0, 0.5),
                sample(1.0, 2.0, 1.0),
                sample(4.0, 4.0, 0.5),
                sample(6.0, 6.0, 1.0)
            ]
        );
        let expected = Repairs {
            nan: 2,
            infinite: 2,
            opacity: 3,
            z_back: 1,
        };
        assert_eq!(repairs, expected);
    }

    #[test]
    fn strict_errors_name_the_pixel_and_the_sample() {
        let found = SampleChannels::resolve(&channels(&["A", "Z", "ZBack"]), None).unwrap();
        for (a, z, z_back, message) in [
            (NAN, 1.0, 1.0, "opacity is NaN"),
            (0.5, NAN, 1.0, "Z is NaN"),
            (0.5, 1.0, INF, "ZBack is inf"),
            (1.5, 1.0, 1.0, "opacity is 1.5"),
            (0.5, 2.0, 1.0, "ZBack before Z 2: it is 1"),
        ] {
            let block = one_pixel(&[&[0.5, a], &[1.0, z], &[1.0, z_back]]);
            let e = found
                .pixel(
                    &block,
                    0,
                    Policy::Strict,
                    &mut Repairs::default(),
                    &mut Vec::new(),
                )
                .unwrap_err();
            assert_eq!(e.to_string(), format!("{message} (pixel 5,-6, sample 1)"));
        }
    }

    #[test]
    fn opacity_comes_from_colours_or_else_grey_or_else_is_opaque() {
        let all = ["A", "AB", "AG", "AR", "BA", "GA", "RA", "Z"];
        let found = |names: &[&str]| SampleChannels::resolve(&channels(names), None);
        assert_eq!(found(&all).unwrap().opacity, Opacity::Channels([3, 2, 1]));
        let second = found(&["A", "GA", "RA", "Z"]).unwrap();
        assert_eq!(second.opacity, Opacity::Channels([2, 1, 0]));
        assert!(second.is_coloured());
        assert_eq!(
            found(&["A", "Z"]).unwrap().opacity,
            Opacity::Channels([0; 3])
        );
        assert!(found(&["R", "Z"]).unwrap().is_opaque());
        assert!(found(&["AR", "Z"]).is_err());
        assert!(found(&["A"]).is_err());
    }

    #[test]
    fn a_layer_is_found_by_name_or_because_it_is_the_only_one() {
        let two = channels(&["a.A", "a.Z", "b.Z", "b.c.Z"]);
        assert!(SampleChannels::resolve(&two, None).is_err());
        assert_eq!(SampleChannels::resolve(&two, Some("b.c")).unwrap().z, 3);
        assert_eq!(
            SampleChannels::resolve(&two[..2], None).unwrap().layer(),
            "a"
        );
        let mixed = channels(&["Z", "a.A", "a.Z"]);
        assert!(SampleChannels::resolve(&mixed, None).unwrap().is_opaque());
    }

    #[test]
    fn a_flat_pixel_at_infinite_depth_is_empty_even_with_the_strict_policy() {
        let window = Rect {
            width: 1,
            height: 1,
            ..Rect::default()
        };
        let mut part = Part::deep_scanline(window, channels(&["Z"]));
        part.deep = false;
        let found = SampleChannels::of(&part, None).unwrap();
        let mut out = Vec::new();
        let mut repairs = Repairs::default();
        found
            .pixel(
                &one_pixel(&[&[INF]]),
                0,
                Policy::Strict,
                &mut repairs,
                &mut out,
            )
            .unwrap();
        assert!(out.is_empty() && repairs.total() == 0);
    }
}
