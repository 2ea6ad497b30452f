//! Transfer functions as text: one point per line, `value extinction` or `value red green blue`;
//! `#` starts a comment.

use crate::error::Result;

use super::text;
use crate::transfer::{TransferFunction, fits};

/// Parses a transfer function.
///
/// ```
/// use deepshadow_scene::load::transfer;
/// let bone = transfer::parse(b"# bone\n100 0\n200 1 0.5 0.25\n")?;
/// assert_eq!(bone.at(150.0), [0.5, 0.25, 0.125]);
/// # Ok::<(), deepshadow_scene::Error>(())
/// ```
///
/// # Errors
/// A line that does not have this form or breaks a rule of [`TransferFunction::new`]; a file
/// without points.
pub fn parse(bytes: &[u8]) -> Result<TransferFunction> {
    let mut points: Vec<(f32, [f32; 3])> = Vec::new();
    for (n, line) in text::lines(bytes) {
        let line = line.split(|&b| b == b'#').next().unwrap_or_default();
        let words = line
            .split(u8::is_ascii_whitespace)
            .filter(|w| !w.is_empty());
        let mut numbers = Vec::new();
        for word in words {
            match text::number::<f32>(word) {
                Some(number) => numbers.push(number),
                None => return text::wrong(n, format!("{} is not a number", text::shown(word))),
            }
        }
        let point = match numbers[..] {
            [] => continue,
            [value, e] => (value, [e; 3]),
            [value, r, g, b] => (value, [r, g, b]),
            _ => {
                let count = numbers.len();
                return text::wrong(
                    n,
                    format!("{count} numbers; a value and one or three extinctions are expected"),
                );
            }
        };
        fits(&points[points.len().saturating_sub(2)..], &point).or_else(|e| text::wrong(n, e))?;
        points.push(point);
    }
    TransferFunction::new(points)
}
