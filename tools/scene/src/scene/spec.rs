//! Parsing and validation that scene files and the command line share.

use std::fmt;

use serde::de::{Deserialize, Deserializer, Error as _, SeqAccess, Visitor};

use crate::error::{Error, Result};

/// Returns an error for the value of a key.
pub fn fault<T>(key: &'static str, why: impl Into<String>) -> Result<T> {
    Err(Error::of_key(key, why))
}

/// Largest magnitude of a number in a scene. Beyond it, f32 would lose precision or overflow.
pub const FAR: f64 = 1e30;

/// Returns the numbers of a key if all are in the range.
///
/// # Errors
/// Names the first number outside the range.
pub fn finite<const N: usize>(
    key: &'static str,
    numbers: [f64; N],
    range: std::ops::RangeInclusive<f64>,
) -> Result<[f64; N]> {
    match numbers.iter().find(|v| !range.contains(v)) {
        None => Ok(numbers),
        Some(v) if *range.end() >= FAR && *range.start() > 0.0 => {
            fault(key, format!("{v} is not a positive number"))
        }
        Some(v) if *range.end() >= FAR => fault(
            key,
            format!("{v} is not a number from {} on", range.start()),
        ),
        Some(v) => fault(
            key,
            format!("{v} is not from {} to {}", range.start(), range.end()),
        ),
    }
}

/// A library enum, parsed from its name.
pub fn named<'de, D, T>(from: D) -> std::result::Result<Option<T>, D::Error>
where
    D: Deserializer<'de>,
    T: std::str::FromStr<Err = deepshadow::Error>,
{
    let name = String::deserialize(from)?;
    name.parse().map(Some).map_err(D::Error::custom)
}

/// One number for all, or `N`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Numbers<const N: usize>(pub [f64; N]);

impl<'de, const N: usize> Deserialize<'de> for Numbers<N> {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        struct OneOrMore<const N: usize>;

        impl<'de, const N: usize> Visitor<'de> for OneOrMore<N> {
            type Value = Numbers<N>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "a number or a list of {N}")
            }

            fn visit_i64<E: serde::de::Error>(self, v: i64) -> std::result::Result<Self::Value, E> {
                Ok(Numbers([v as f64; N]))
            }

            fn visit_u64<E: serde::de::Error>(self, v: u64) -> std::result::Result<Self::Value, E> {
                Ok(Numbers([v as f64; N]))
            }

            fn visit_f64<E: serde::de::Error>(self, v: f64) -> std::result::Result<Self::Value, E> {
                Ok(Numbers([v; N]))
            }

            fn visit_seq<A: SeqAccess<'de>>(
                self,
                mut list: A,
            ) -> std::result::Result<Self::Value, A::Error> {
                let mut numbers = [0.0; N];
                for (i, number) in numbers.iter_mut().enumerate() {
                    *number = list
                        .next_element()?
                        .ok_or_else(|| A::Error::invalid_length(i, &self))?;
                }
                match list.next_element::<f64>()? {
                    None => Ok(Numbers(numbers)),
                    Some(_) => Err(A::Error::invalid_length(N + 1, &self)),
                }
            }
        }
        from.deserialize_any(OneOrMore)
    }
}

impl<const N: usize> std::str::FromStr for Numbers<N> {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
        match numbers.as_deref() {
            Some(&[one]) => Ok(Numbers([one; N])),
            Some(list) if list.len() == N => Ok(Numbers(std::array::from_fn(|i| list[i]))),
            _ => Err(format!("not a number, nor {N} with commas between")),
        }
    }
}
