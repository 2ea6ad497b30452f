//! How a file stores its maps: names of compressors and codecs on the command line.

use clap::ValueEnum;
use deepshadow::Codec;

/// [`Compressor`](deepshadow::Compressor) by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum CompressorName {
    /// The paper's greedy walk: the fastest
    Croquet,
    /// The walk with the next origin left open
    Lookahead,
    /// A search for the fewest vertices
    Minimal,
}

/// The codec called `none`, `lz4`, `zstd` (at level `usual`) or `zstd:LEVEL`.
pub fn codec_named(name: &str, usual: i32) -> Option<Codec> {
    match name.split_once(':') {
        None if name == "none" => Some(Codec::None),
        None if name == "lz4" => Some(Codec::Lz4),
        None if name == "zstd" => Some(Codec::Zstd(usual)),
        Some(("zstd", level)) => level
            .parse()
            .ok()
            .filter(|l| (1..=22).contains(l))
            .map(Codec::Zstd),
        _ => None,
    }
}
