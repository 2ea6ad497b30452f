//! MetaImage (`.mhd`, `.mha`): lines of `Field = value`. `ElementDataFile` is the last field and
//! gives the place of the samples.

use crate::error::Result;

use super::bytes::Endian;
use super::fault;
use super::samples::{Data, Encoding, Header, Kind};
use super::text::{shown, wrong};

/// Parses the header of a MetaImage: scalars along three axes, plain or compressed with zlib.
///
/// Only the spacing of the samples is used; the scene's transform gives the orientation.
///
/// # Errors
/// A line that cannot be parsed or has an unsupported value, or a missing field. [`Header::grid`]
/// checks the samples.
pub fn parse(bytes: &[u8]) -> Result<Header<'_>> {
    let mut out = Header {
        size: [0; 3],
        spacing: [1.0; 3],
        kind: Kind::U8,
        endian: Endian::Little,
        encoding: Encoding::Plain,
        skip_lines: 0,
        skip_bytes: Some(0),
        data: Data::Here(&[]),
    };
    let (mut kind, mut spaced) = (None, false);
    let mut rest = bytes;
    for n in 1.. {
        if rest.is_empty() {
            break;
        }
        let end = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
        let line = String::from_utf8_lossy(&rest[..end]);
        rest = rest.get(end + 1..).unwrap_or_default();
        if line.trim().is_empty() {
            continue;
        }
        let Some((name, value)) = line.split_once('=') else {
            return wrong(n, format!("{} is not a field", shown(line.as_bytes())));
        };
        let (name, value) = (name.trim(), value.trim());
        let bad = format!("{name} {} is not understood", shown(value.as_bytes()));
        let truth = || match value.to_lowercase().as_str() {
            "true" | "1" => Ok(true),
            "false" | "0" => Ok(false),
            _ => wrong(n, &bad),
        };
        match name {
            "NDims" if value != "3" => {
                let shown = shown(value.as_bytes());
                return wrong(n, format!("{shown} axes; three are expected"));
            }
            "DimSize" => out.size = three(value).map_or_else(|| wrong(n, &bad), Ok)?,
            // The distance between samples. ElementSize is used only without it.
            "ElementSpacing" => {
                out.spacing = three(value).map_or_else(|| wrong(n, &bad), Ok)?;
                spaced = true;
            }
            "ElementSize" if !spaced => {
                out.spacing = three(value).map_or_else(|| wrong(n, &bad), Ok)?;
            }
            "ElementNumberOfChannels" if value != "1" => {
                return wrong(n, "samples of several numbers; one each is expected");
            }
            "ElementByteOrderMSB" | "BinaryDataByteOrderMSB" => {
                out.endian = if truth()? {
                    Endian::Big
                } else {
                    Endian::Little
                };
            }
            "CompressedData" if truth()? => out.encoding = Encoding::Zlib,
            "HeaderSize" => {
                out.skip_bytes = match value.parse::<i64>() {
                    Ok(skip) if skip >= -1 => u64::try_from(skip).ok(),
                    _ => return wrong(n, &bad),
                };
            }
            "ElementType" => match named(value) {
                Some(named) => kind = Some(named),
                None => {
                    let shown = shown(value.as_bytes());
                    return wrong(
                        n,
                        format!(
                            "samples of type {shown}; \
                             only integers of 8, 16 and 32 bits, float and double are read"
                        ),
                    );
                }
            },
            "ElementDataFile" => {
                let Some(kind) = kind else {
                    return fault("the header has no ElementType");
                };
                if value.starts_with("LIST") || value.contains('%') || value.is_empty() {
                    return wrong(n, "samples in several files; one is expected");
                }
                if out.encoding != Encoding::Plain && out.skip_bytes != Some(0) {
                    return fault("HeaderSize together with CompressedData is not read");
                }
                out.kind = kind;
                out.data = match value {
                    "LOCAL" | "Local" | "local" => Data::Here(rest),
                    file => Data::In(file.to_owned()),
                };
                return Ok(out);
            }
            _ => {}
        }
    }
    fault("the header ends without ElementDataFile")
}

fn three<T: std::str::FromStr>(value: &str) -> Option<[T; 3]> {
    let numbers: Option<Vec<T>> = value.split_whitespace().map(|n| n.parse().ok()).collect();
    numbers?.try_into().ok()
}

fn named(name: &str) -> Option<Kind> {
    Some(match name {
        "MET_CHAR" => Kind::I8,
        "MET_UCHAR" => Kind::U8,
        "MET_SHORT" => Kind::I16,
        "MET_USHORT" => Kind::U16,
        "MET_INT" => Kind::I32,
        "MET_UINT" => Kind::U32,
        "MET_FLOAT" => Kind::F32,
        "MET_DOUBLE" => Kind::F64,
        _ => return None,
    })
}
