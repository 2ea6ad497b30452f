//! Options whose values are the names of a library's enum.

use std::ffi::OsStr;
use std::fmt::Display;
use std::str::FromStr;

use clap::builder::{PossibleValue, PossibleValuesParser, StringValueParser, TypedValueParser};
use clap::{Arg, Command};

/// A parser for the names of `all`: it takes what the library takes for them, and `--help` lists
/// them.
pub fn choice<T>(all: &'static [T]) -> Choice<T> {
    Choice(all)
}

/// The parser that [`choice`] makes.
#[derive(Debug)]
pub struct Choice<T: 'static>(&'static [T]);

impl<T> Clone for Choice<T> {
    fn clone(&self) -> Self {
        Choice(self.0)
    }
}

impl<T: Display> Choice<T> {
    fn names(&self) -> impl Iterator<Item = PossibleValue> {
        // The parser of a command line lives as long as the program.
        let name = |v: &T| PossibleValue::new(&*Box::leak(v.to_string().into_boxed_str()));
        self.0.iter().map(name)
    }
}

impl<T> TypedValueParser for Choice<T>
where
    T: Clone + Display + FromStr + PartialEq + Send + Sync + 'static,
{
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
                // The error for values that are not in a list; no name of the list gets here.
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
    use deepshadow::{DepthKind, Filter};

    fn parsed<T>(all: &'static [T], text: &str) -> Result<T, String>
    where
        T: Clone + Display + FromStr + PartialEq + Send + Sync + 'static,
    {
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
}
