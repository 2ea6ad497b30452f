//! Numbers, names and tables for people.

use std::fmt::Write;

use deepshadow_frame::output::is_control;

/// `1234567` as `1,234,567`.
pub fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

/// `n thing`, or `n things`.
pub fn counted(n: u64, thing: &str) -> String {
    let s = if n == 1 { "" } else { "s" };
    format!("{} {thing}{s}", grouped(n))
}

/// A number with up to six digits that count.
pub fn short(v: f64) -> String {
    let rounded: f64 = format!("{v:.5e}").parse().unwrap_or(v);
    match rounded.abs() {
        0.0 => "0".into(),
        1e-4..1e9 => rounded.to_string(),
        _ => format!("{rounded:e}"),
    }
}

/// An f32 in the fewest digits that tell it from its neighbours.
pub fn exact(v: f32) -> String {
    match v.abs() {
        0.0 | 1e-5..1e9 => v.to_string(),
        _ => format!("{v:e}"),
    }
}

/// A part of a whole in per cent.
pub fn share(part: u64, whole: u64) -> String {
    if whole == 0 {
        return "0.0 %".into();
    }
    format!("{:.1} %", 100.0 * part as f64 / whole as f64)
}

/// A ratio with two decimals; `-` of nothing.
pub fn ratio(part: f64, whole: f64) -> String {
    if whole == 0.0 {
        return "-".into();
    }
    format!("{:.2}", part / whole)
}

/// Bytes in hexadecimal.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut out, b| {
        let _ = write!(out, "{b:02x}");
        out
    })
}

/// Text in quotation marks on one line, of at most `most` characters: nothing in it can move a
/// terminal's cursor.
pub fn quoted(text: &str, most: usize) -> String {
    let mut out = String::from("\"");
    let mut length = 0;
    for c in text.chars() {
        let shown = match c {
            '"' | '\\' => format!("\\{c}"),
            c if is_control(c) => c.escape_default().to_string(),
            c => c.to_string(),
        };
        length += shown.chars().count();
        if length > most {
            out.push_str("...");
            break;
        }
        out.push_str(&shown);
    }
    out.push('"');
    out
}

/// Lines of a table whose columns are as wide as they must be.
#[derive(Clone, Debug)]
pub struct Table {
    left: Vec<bool>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// A table with these headings; a `<` before one aligns its column to the left.
    pub fn new(headings: &[&str]) -> Self {
        let name = |h: &&str| h.trim_start_matches('<').to_string();
        Table {
            left: headings.iter().map(|h| h.starts_with('<')).collect(),
            rows: vec![headings.iter().map(name).collect()],
        }
    }

    /// Adds a row.
    pub fn row(&mut self, cells: Vec<String>) {
        self.rows.push(cells);
    }

    /// The lines, indented by two.
    pub fn lines(&self) -> impl Iterator<Item = String> {
        let width = |c: usize| {
            let widths = self.rows.iter().filter_map(|r| r.get(c));
            widths.map(|s| s.chars().count()).max().unwrap_or(0)
        };
        let widths: Vec<usize> = (0..self.left.len()).map(width).collect();
        self.rows.iter().map(move |row| {
            let mut line = String::new();
            for ((cell, &width), &left) in row.iter().zip(&widths).zip(&self.left) {
                let _ = if left {
                    write!(line, "  {cell:<width$}")
                } else {
                    write!(line, "  {cell:>width$}")
                };
            }
            line.truncate(line.trim_end().len());
            line
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well() {
        assert_eq!(grouped(0), "0");
        assert_eq!(grouped(999), "999");
        assert_eq!(grouped(1_234_567), "1,234,567");
        assert_eq!(short(0.01), "0.01");
        assert_eq!(short(1.0 / 3.0), "0.333333");
        assert_eq!(short(1.5e-7), "1.5e-7");
        assert_eq!(exact(0.1), "0.1");
        assert_eq!(exact(f32::MAX), "3.4028235e38");
        assert_eq!(share(1, 0), "0.0 %");
    }

    #[test]
    fn hostile_names_stay_on_their_line() {
        assert_eq!(quoted("a\u{1b}[2J\n", 40), r#""a\u{1b}[2J\n""#);
        assert_eq!(quoted("abcdef", 3), "\"abc...\"");
        assert_eq!(quoted("x\u{202e}y", 40), r#""x\u{202e}y""#);
    }

    #[test]
    fn columns_line_up() {
        let mut table = Table::new(&["<name", "n"]);
        table.row(vec!["a".into(), "100".into()]);
        let lines: Vec<_> = table.lines().collect();
        assert_eq!(lines, ["  name    n", "  a     100"]);
    }
}
