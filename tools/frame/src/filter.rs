//! The filters of lookups by their names, for both tools.

use clap::ValueEnum;
use deepshadow::Filter;

/// [`Filter`] by name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum FilterName {
    /// The pixel that holds the point
    Nearest,
    /// Every place in the footprint alike
    Box,
    /// Falls to nothing at one width from the point
    #[default]
    Triangle,
    /// Falls to 0.0003 at two widths
    Gaussian,
    /// Sharper than the others, ends at two widths
    CatmullRom,
}

impl FilterName {
    /// The filter.
    pub fn filter(self) -> Filter {
        match self {
            FilterName::Nearest => Filter::Nearest,
            FilterName::Box => Filter::Box,
            FilterName::Triangle => Filter::Triangle,
            FilterName::Gaussian => Filter::Gaussian,
            FilterName::CatmullRom => Filter::CatmullRom,
        }
    }
}

/// The name of a choice, as it is written on the command line.
pub fn name_of(choice: impl ValueEnum) -> String {
    let value = choice.to_possible_value();
    value.map_or_else(String::new, |v| v.get_name().to_owned())
}

/// A width of footprints from the command line.
///
/// # Errors
/// What is wrong with it: it is negative, infinite or no number.
pub fn width(text: &str) -> Result<f32, String> {
    match text.trim().parse() {
        Ok(w) if (0.0..f32::INFINITY).contains(&w) => Ok(w),
        _ => Err("a width is a number of pixels, 0 or more".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_filter_has_the_name_of_the_library_in_small_letters() {
        for name in FilterName::value_variants() {
            let own = name_of(*name).replace('-', "");
            assert_eq!(own, format!("{:?}", name.filter()).to_lowercase());
        }
    }

    #[test]
    fn widths_are_finite_and_not_negative() {
        assert_eq!(width("2.5"), Ok(2.5));
        assert_eq!(width("0"), Ok(0.0));
        for wrong in ["-1", "nan", "inf", "1e39", "", "two"] {
            assert!(width(wrong).is_err(), "{wrong}");
        }
    }
}
