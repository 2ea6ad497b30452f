//! NRRD: lines of `field: value`, an empty line, and then the samples; or the name of the file with
//! the samples.

use crate::error::Result;

use super::bytes::Endian;
use super::fault;
use super::samples::{Data, Encoding, Header, Kind};
use super::text::{number, shown, wrong};

/// Parses the header of an attached (`.nrrd`) or detached (`.nhdr`) file. Samples are scalars along
/// three axes: plain, compressed with gzip, or text.
///
/// Only the lengths of `space directions` are used, as spacing; the scene's transform gives the
/// orientation.
///
/// # Errors
/// Not NRRD; a line that cannot be parsed or has an unsupported value; a missing field.
/// [`Header::grid`] checks the samples.
pub fn parse(bytes: &[u8]) -> Result<Header<'_>> {
    let mut fields = Fields::default();
    let mut rest = bytes;
    for n in 1.. {
        let end = rest.iter().position(|&b| b == b'\n');
        let line = &rest[..end.unwrap_or(rest.len())];
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        let ended = end.is_none();
        rest = end.map_or(&[], |end| &rest[end + 1..]);
        match n {
            1 if !line.starts_with(b"NRRD000") => return fault("does not begin with NRRD000"),
            1 => {}
            _ if line.is_empty() => break,
            _ if line[0] == b'#' => {}
            _ => fields.line(n, line)?,
        }
        if ended {
            rest = &[];
            break;
        }
    }
    fields.header(rest)
}

/// The fields read so far.
#[derive(Default)]
struct Fields {
    kind: Option<Kind>,
    dimension: Option<u64>,
    sizes: Vec<u64>,
    spacings: Option<Vec<f64>>,
    directions: Option<Vec<f64>>,
    encoding: Option<Encoding>,
    endian: Option<Endian>,
    skip_lines: u64,
    skip_bytes: i64,
    file: Option<String>,
}

impl Fields {
    fn line(&mut self, n: usize, line: &[u8]) -> Result<()> {
        let line = String::from_utf8_lossy(line);
        let Some((name, value)) = line.split_once(':') else {
            return wrong(n, format!("{} is not a field", shown(line.as_bytes())));
        };
        // A key/value pair; these have no effect.
        if value.starts_with('=') {
            return Ok(());
        }
        let (name, value) = (name.trim().to_lowercase(), value.trim());
        let bad = format!("{name} {} is not understood", shown(value.as_bytes()));
        match name.as_str() {
            "type" => match kind(&value.to_lowercase()) {
                Some(kind) => self.kind = Some(kind),
                None => {
                    return wrong(
                        n,
                        format!(
                            "samples of type {}; \
                             only integers of 8, 16 and 32 bits, float and double are read",
                            shown(value.as_bytes())
                        ),
                    );
                }
            },
            "dimension" => self.dimension = Some(value.parse().or_else(|_| wrong(n, &bad))?),
            "sizes" => match value.split_whitespace().map(str::parse).collect() {
                Ok(sizes) => self.sizes = sizes,
                Err(_) => return wrong(n, &bad),
            },
            // "nan" and "none" mean that an axis has no spacing.
            "spacings" => match value.split_whitespace().map(str::parse).collect() {
                Ok(spacings) => self.spacings = Some(spacings),
                Err(_) => return wrong(n, &bad),
            },
            "space directions" => match value.split_whitespace().map(length).collect() {
                Some(lengths) => self.directions = Some(lengths),
                None => return wrong(n, &bad),
            },
            "encoding" => match value.to_lowercase().as_str() {
                "raw" => self.encoding = Some(Encoding::Plain),
                "gzip" | "gz" => self.encoding = Some(Encoding::Gzip),
                "text" | "txt" | "ascii" => self.encoding = Some(Encoding::Text),
                _ => {
                    let shown = shown(value.as_bytes());
                    return wrong(
                        n,
                        format!("the encoding {shown}; raw, gzip and text are read"),
                    );
                }
            },
            "endian" => match value.to_lowercase().as_str() {
                "little" => self.endian = Some(Endian::Little),
                "big" => self.endian = Some(Endian::Big),
                _ => return wrong(n, &bad),
            },
            "line skip" | "lineskip" => {
                self.skip_lines = value.parse().or_else(|_| wrong(n, &bad))?
            }
            "byte skip" | "byteskip" => match value.parse() {
                Ok(skip) if skip >= -1 => self.skip_bytes = skip,
                _ => return wrong(n, &bad),
            },
            "data file" | "datafile" => {
                if value.starts_with("LIST") || value.contains('%') || value.is_empty() {
                    return wrong(n, "samples in several files; one is expected");
                }
                self.file = Some(value.to_owned());
            }
            _ => {}
        }
        Ok(())
    }

    fn header(self, rest: &[u8]) -> Result<Header<'_>> {
        let Some(kind) = self.kind else {
            return fault("the header has no type");
        };
        let Some(encoding) = self.encoding else {
            return fault("the header has no encoding");
        };
        let (Some(3), Ok(size)) = (self.dimension, <[u64; 3]>::try_from(&self.sizes[..])) else {
            let axes = self.dimension.unwrap_or(0);
            return fault(format!(
                "{axes} axes of {:?} samples; three axes of scalars are expected",
                self.sizes
            ));
        };
        let endian = match (self.endian, kind.bytes(), encoding) {
            (Some(endian), ..) => endian,
            (None, 1, _) | (None, _, Encoding::Text) => Endian::Little,
            (None, ..) => return fault("the header has no endian"),
        };
        let spacing = match self.directions.or(self.spacings) {
            None => [1.0; 3],
            Some(steps) => match <[f64; 3]>::try_from(&steps[..]) {
                // An axis without spacing gets 1.
                Ok(steps) => steps.map(|s| if s.is_nan() { 1.0 } else { s.abs() }),
                Err(_) => {
                    let n = steps.len();
                    return fault(format!("spacing of {n} axes; three are expected"));
                }
            },
        };
        Ok(Header {
            size,
            spacing,
            kind,
            endian,
            encoding,
            skip_lines: self.skip_lines,
            skip_bytes: u64::try_from(self.skip_bytes).ok(),
            data: match self.file {
                Some(file) => Data::In(file),
                None => Data::Here(rest),
            },
        })
    }
}

fn kind(name: &str) -> Option<Kind> {
    Some(match name {
        "signed char" | "int8" | "int8_t" => Kind::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => Kind::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => {
            Kind::I16
        }
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => Kind::U16,
        "int" | "signed int" | "int32" | "int32_t" => Kind::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => Kind::U32,
        "float" => Kind::F32,
        "double" => Kind::F64,
        _ => return None,
    })
}

/// The length of a vector such as `(0,2,0)`; NaN for `none`.
fn length(vector: &str) -> Option<f64> {
    if vector == "none" {
        return Some(f64::NAN);
    }
    let inner = vector.strip_prefix('(')?.strip_suffix(')')?;
    let mut sum = 0.0;
    for x in inner.split(',') {
        let x: f64 = number(x.trim().as_bytes())?;
        sum += x * x;
    }
    // Vectors with NaN components are invalid.
    (!sum.is_nan()).then(|| sum.sqrt())
}
