//! Options whose values are the names of an enum of the library.

use std::ffi::OsStr;
use std::fmt::Display;
use std::str::FromStr;

use clap::builder::{PossibleValue, PossibleValuesParser, StringValueParser, TypedValueParser};
use clap::{Arg, Command};
use deepshadow::{Border, Compressor, DepthKind, Filter, LevelChoice};

/// An enum of the library whose values an option takes by name.
pub trait Named: Clone + Display + FromStr + PartialEq + Send + Sync + 'static {
    /// A sentence about this value for `--help`; empty for values without one.
    fn help(&self) -> &'static str;
}

impl Named for Compressor {
    fn help(&self) -> &'static str {
        match self {
            Compressor::Croquet => "Greedy, as in the paper: fastest, most vertices",
            Compressor::Lookahead => "Greedy with a free start value: fewer vertices",
            Compressor::Minimal => "Search over several values: slowest, fewest vertices",
            _ => "",
        }
    }
}

impl Named for Filter {
    fn help(&self) -> &'static str {
        match self {
            Filter::Nearest => "The nearest sample alone",
            Filter::Box => "Equal weight over the whole width",
            Filter::Triangle => "Weight that falls linearly to 0 at a distance of one width",
            Filter::Gaussian => "Smooth weight that ends at a distance of two widths",
            Filter::CatmullRom => "Sharp cubic with negative weights; ends at two widths",
            _ => "",
        }
    }
}

impl Named for DepthKind {
    fn help(&self) -> &'static str {
        match self {
            DepthKind::Unspecified => "Unknown; points in world space cannot be looked up",
            DepthKind::Planar => "The z coordinate in camera space",
            DepthKind::RayDistance => "The distance from the camera along the ray",
        }
    }
}

impl Named for LevelChoice {
    fn help(&self) -> &'static str {
        match self {
            LevelChoice::Blend => "Blend the two levels whose pixels are nearest to the width",
            LevelChoice::One => "Use the coarsest level whose pixels are at most as wide",
            LevelChoice::Base => "Use level 0, at any cost",
            _ => "",
        }
    }
}

impl Named for Border {
    fn help(&self) -> &'static str {
        match self {
            Border::Lit => "Points outside the map are lit at every depth",
            Border::Clamp => "Points outside the map have the value of the nearest pixel",
            _ => "",
        }
    }
}

/// Returns a parser for the names of the values in `all`. `--help` lists them with a sentence each.
pub fn choice<T>(all: &'static [T]) -> Choice<T> {
    Choice(all)
}

/// The parser that [`choice()`] makes.
#[derive(Debug)]
pub struct Choice<T: 'static>(&'static [T]);

impl<T> Clone for Choice<T> {
    fn clone(&self) -> Self {
        Choice(self.0)
    }
}

impl<T: Named> Choice<T> {
    fn names(&self) -> impl Iterator<Item = PossibleValue> {
        // Leaks a few bytes; a program makes each parser once or twice.
        let name = |v: &T| {
            let name = &*Box::leak(v.to_string().into_boxed_str());
            PossibleValue::new(name).help(v.help())
        };
        self.0.iter().map(name)
    }
}

impl<T: Named> TypedValueParser for Choice<T> {
    type Value = T;

    fn parse_ref(
        &self,
        command: &Command,
        arg: Option<&Arg>,
        value: &OsStr,
    ) -> Result<T, clap::Error> {
        let text = StringValueParser::new().parse_ref(command, arg, value)?;
        match text.parse() {
            Ok(value) if self.0.contains(&value) => Ok(value),
            _ => {
                // clap's own error lists the names. This parser rejects all text that gets here.
                let parser = PossibleValuesParser::new(self.names().collect::<Vec<_>>());
                let refused = parser.parse_ref(command, arg, value).err();
                Err(refused
                    .unwrap_or_else(|| clap::Error::new(clap::error::ErrorKind::InvalidValue)))
            }
        }
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(self.names()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed<T: Named>(all: &'static [T], text: &str) -> Result<T, String> {
        let parsed = choice(all).parse_ref(&Command::new("dsm-test"), None, OsStr::new(text));
        parsed.map_err(|e| e.to_string())
    }

    #[test]
    fn a_choice_takes_the_names_of_the_library() {
        assert_eq!(parsed(Filter::ALL, "catmull-rom"), Ok(Filter::CatmullRom));
        assert_eq!(parsed(DepthKind::ALL, "ray"), Ok(DepthKind::RayDistance));
        assert!(parsed(&Filter::ALL[1..], "nearest").is_err());
        let error = parsed(Filter::ALL, "bilinear").unwrap_err();
        assert!(error.contains("nearest, box, triangle"), "{error}");
    }

    #[test]
    fn every_value_has_a_sentence_in_the_help() {
        fn all<T: Named>(all: &[T]) {
            assert!(all.iter().all(|value| !value.help().is_empty()));
        }
        all(Compressor::ALL);
        all(Filter::ALL);
        all(DepthKind::ALL);
        all(LevelChoice::ALL);
        all(Border::ALL);
    }
}
