//! The shape of a block's bytes before packing.

use std::ops::Range;

/// In which order the rows of channels follow each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Order {
    /// Row by row; in a row, channel by channel.
    Packed,
    /// As Zstandard wants it: first the two-byte channels of all rows, then the four-byte ones.
    Sorted,
}

/// The shape of a block's bytes: samples of each row, bytes of each channel's values.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layout<'a> {
    pub(crate) row_samples: &'a [usize],
    pub(crate) channel_bytes: &'a [usize],
}

impl Layout<'_> {
    fn samples(&self) -> usize {
        self.row_samples.iter().sum()
    }

    /// Bytes of the whole block.
    pub(crate) fn bytes(&self) -> usize {
        self.samples() * self.channel_bytes.iter().sum::<usize>()
    }

    /// Bytes of the two-byte channels.
    pub(crate) fn two_bytes(&self) -> usize {
        2 * self.samples() * self.channel_bytes.iter().filter(|&&b| b == 2).count()
    }

    /// Whether both orders are one.
    pub(crate) fn is_sorted(&self) -> bool {
        self.row_samples.len() == 1 && self.channel_bytes.is_sorted()
    }

    /// Calls `f` with row, channel and bytes of all rows of channels, in the order of the bytes.
    pub(crate) fn each(&self, order: Order, mut f: impl FnMut(usize, usize, Range<usize>)) {
        let mut at = 0;
        let mut pass = |wanted: &dyn Fn(usize) -> bool| {
            for (row, &samples) in self.row_samples.iter().enumerate() {
                for (channel, &bytes) in self.channel_bytes.iter().enumerate() {
                    if wanted(bytes) {
                        f(row, channel, at..at + samples * bytes);
                        at += samples * bytes;
                    }
                }
            }
        };
        match order {
            Order::Packed => pass(&|_| true),
            Order::Sorted => {
                pass(&|bytes| bytes == 2);
                pass(&|bytes| bytes != 2);
            }
        }
    }

    /// Replaces `sorted` by the bytes of `packed` in the other order.
    pub(crate) fn sort(&self, packed: &[u8], sorted: &mut Vec<u8>) {
        let mut spans = vec![0..0; self.row_samples.len() * self.channel_bytes.len()];
        let channels = self.channel_bytes.len();
        self.each(Order::Packed, |row, channel, span| {
            spans[row * channels + channel] = span;
        });
        sorted.clear();
        self.each(Order::Sorted, |row, channel, _| {
            sorted.extend_from_slice(&packed[spans[row * channels + channel].clone()]);
        });
    }
}
