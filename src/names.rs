//! Enums with names: one table a type gives `ALL`, `Display` and `FromStr`.

use std::fmt::Display;

use crate::Error;

/// `names!(Type, "word for errors" { Variant = "name" | "other word", .. })`.
///
/// `Display` writes the name. `FromStr` takes the name and the other words; its error lists the
/// names.
macro_rules! names {
    ($type:ident, $what:literal {
        $($variant:ident = $name:literal $(| $other:literal)*),+ $(,)?
    }) => {
        impl $type {
            /// All values, in the order of their declaration.
            pub const ALL: &[Self] = &[$(Self::$variant),+];
        }

        impl std::fmt::Display for $type {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.pad(match self {
                    $(Self::$variant => $name),+
                })
            }
        }

        impl std::str::FromStr for $type {
            type Err = crate::Error;

            /// # Errors
            /// `Input` for another word; the error lists the names.
            fn from_str(text: &str) -> crate::Result<Self> {
                match text {
                    $($name $(| $other)* => Ok(Self::$variant),)+
                    _ => Err(crate::names::unknown($what, text, Self::ALL)),
                }
            }
        }
    };
}

/// `bytes!(Type)`: the bytes of a type of [`names!`] in a file are its discriminants.
macro_rules! bytes {
    ($type:ident) => {
        impl $type {
            /// The byte that stands for this value in a file.
            pub(crate) fn byte(self) -> u8 {
                self as u8
            }

            /// The value of a byte in a file; `None` if no value has it.
            pub(crate) fn from_byte(byte: u8) -> Option<Self> {
                Self::ALL.iter().copied().find(|v| v.byte() == byte)
            }
        }
    };
}

pub(crate) use {bytes, names};

/// The error for a word that names no value of a type.
#[cold]
pub(crate) fn unknown<T: Display>(what: &str, text: &str, all: &[T]) -> Error {
    let names: Vec<String> = all.iter().map(T::to_string).collect();
    Error::input(format!(
        "there is no {what} {text:?}; there are {}",
        names.join(", ")
    ))
}
