//! Names of enum values: one table per type generates `ALL`, `Display` and `FromStr`.

use std::fmt::Display;

use crate::Error;

/// `names!(Type, "type in errors" { Variant = "name" | "alias", .. })`.
///
/// `Display` writes the name. `FromStr` accepts the name and its aliases; its error lists the
/// names.
macro_rules! names {
    ($type:ident, $what:literal {
        $($variant:ident = $name:literal $(| $other:literal)*),+ $(,)?
    }) => {
        impl $type {
            /// All values in declaration order.
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
            /// `Input` for any other text; the error lists the names.
            fn from_str(text: &str) -> crate::Result<Self> {
                match text {
                    $($name $(| $other)* => Ok(Self::$variant),)+
                    _ => Err(crate::names::unknown($what, text, Self::ALL)),
                }
            }
        }
    };
}

/// `bytes!(Type, "RULE")`: converts a type of [`names!`] to bytes of a file, by its discriminants.
macro_rules! bytes {
    ($type:ident, $rule:literal) => {
        impl $type {
            /// The byte that stands for this value in a file.
            pub(crate) fn byte(self) -> u8 {
                self as u8
            }

            /// The value that a byte of a file stands for.
            pub(crate) fn from_byte(byte: u8) -> crate::Result<Self> {
                let found = Self::ALL.iter().copied().find(|v| v.byte() == byte);
                let what = || format!("there is no {} {byte}", stringify!($type));
                found.ok_or_else(|| crate::Error::corrupt($rule, what()))
            }
        }
    };
}

pub(crate) use {bytes, names};

/// The error for a text that is not the name of a value.
#[cold]
pub(crate) fn unknown<T: Display>(what: &str, text: &str, all: &[T]) -> Error {
    let names: Vec<String> = all.iter().map(T::to_string).collect();
    Error::input(format!(
        "there is no {what} {text:?}; there are {}",
        names.join(", ")
    ))
}
