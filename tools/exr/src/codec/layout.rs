//! The layout of a block's bytes before compression.

use std::ops::Range;

/// The order of a block's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Order {
    /// Row by row; channel by channel in each row.
    Packed,
    /// The order for Zstandard: the two-byte channels of all rows, then the four-byte channels.
    Sorted,
}

/// The shape of a block: samples of each row, bytes per value of each channel.
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

    /// Whether both orders are the same.
    pub(crate) fn is_sorted(&self) -> bool {
        self.row_samples.len() == 1 && self.channel_bytes.is_sorted()
    }

    /// Calls `f` with the row, channel and byte range of every row of a channel, in byte order.
    pub(crate) fn for_each_row(&self, order: Order, mut f: impl FnMut(usize, usize, Range<usize>)) {
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

    /// Replaces the contents of `sorted` with the bytes of `packed` in [`Order::Sorted`].
    pub(crate) fn sort(&self, packed: &[u8], sorted: &mut Vec<u8>) {
        let mut spans = vec![0..0; self.row_samples.len() * self.channel_bytes.len()];
        let channels = self.channel_bytes.len();
        self.for_each_row(Order::Packed, |row, channel, span| {
            spans[row * channels + channel] = span;
        });
        sorted.clear();
        self.for_each_row(Order::Sorted, |row, channel, _| {
            sorted.extend_from_slice(&packed[spans[row * channels + channel].clone()]);
        });
    }
}
