//! Queries, batches of queries, and the options of samplers.

use crate::Filter;
use crate::names::names;

/// The area of the map that a lookup averages, in pixels of level 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Footprint {
    /// A round area of this width. Widths below 1 count as 1; widths above four times the map count
    /// as four times the map.
    Width(f32),
    /// An ellipse, given by two vectors: the moves of the point in the map for one step along each
    /// of the renderer's two directions.
    Ellipse {
        /// First vector: x, y.
        dx: [f32; 2],
        /// Second vector: x, y.
        dy: [f32; 2],
    },
}

impl Footprint {
    /// Exclusive limit of widths and of the coordinates of vectors: 2^40 pixels.
    pub const LONGEST: f32 = 1_099_511_627_776.0;
}

/// One lookup in a map: a place, a depth and a footprint.
///
/// ```
/// use deepshadow::{Footprint, Query};
/// let q = Query::new(12.5, 7.5, 3.0).width(4.0).bias(0.01);
/// assert_eq!((q.footprint, q.bias), (Footprint::Width(4.0), 0.01));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Query {
    /// Pixels of level 0 from the left border; the centre of the first pixel is 0.5.
    pub x: f32,
    /// Pixels of level 0 from the top.
    pub y: f32,
    /// Depth, in the units of the map. Infinity gives the visibility behind everything.
    pub depth: f32,
    /// Subtracted from the depth before the lookup.
    ///
    /// LV00, section 4: the shaded surface is itself in the map. At exactly its own depth it does
    /// not shadow itself, because the value at a step is the one in front of the step. But a filter
    /// also reads neighbouring pixels where the surface lies nearer, and the shaded point is not
    /// computed in the same way as the stored one. A bias of about the footprint's width times the
    /// slope of the surface, in units of depth, avoids spots. Deep maps need a smaller bias than
    /// plain maps: a tilted surface, filtered over a pixel, is a ramp and not a step.
    pub bias: f32,
    /// The area that is averaged.
    pub footprint: Footprint,
}

impl Query {
    /// A lookup at (x, y), one pixel wide, without bias.
    pub fn new(x: f32, y: f32, depth: f32) -> Self {
        Query {
            x,
            y,
            depth,
            bias: 0.0,
            footprint: Footprint::Width(1.0),
        }
    }

    /// Sets the depth.
    pub fn depth(mut self, depth: f32) -> Self {
        self.depth = depth;
        self
    }

    /// Sets a round footprint, `width` pixels of level 0 wide.
    pub fn width(mut self, width: f32) -> Self {
        self.footprint = Footprint::Width(width);
        self
    }

    /// Sets an elliptic footprint.
    pub fn ellipse(mut self, dx: [f32; 2], dy: [f32; 2]) -> Self {
        self.footprint = Footprint::Ellipse { dx, dy };
        self
    }

    /// Sets the depth bias.
    pub fn bias(mut self, bias: f32) -> Self {
        self.bias = bias;
        self
    }
}

/// Many lookups, as one array for each coordinate.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Batch<'a> {
    /// As [`Query::x`].
    pub x: &'a [f32],
    /// As [`Query::y`]; as many as `x`.
    pub y: &'a [f32],
    /// As [`Query::depth`]; as many as `x`.
    pub depth: &'a [f32],
    /// One footprint for all lookups, or as many as `x`.
    pub footprints: &'a [Footprint],
    /// The depth bias of all lookups, as [`Query::bias`].
    pub bias: f32,
}

impl<'a> Batch<'a> {
    /// Lookups one pixel wide, without bias.
    pub fn new(x: &'a [f32], y: &'a [f32], depth: &'a [f32]) -> Self {
        Batch {
            x,
            y,
            depth,
            footprints: &[Footprint::Width(1.0)],
            bias: 0.0,
        }
    }

    /// Sets the footprints: one for all lookups, or one for each.
    pub fn footprints(mut self, footprints: &'a [Footprint]) -> Self {
        self.footprints = footprints;
        self
    }

    /// Sets the depth bias of all lookups.
    pub fn bias(mut self, bias: f32) -> Self {
        self.bias = bias;
        self
    }
}

/// The levels that a lookup reads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum LevelChoice {
    /// The two levels whose pixel widths enclose the footprint's width, with a kernel of one pixel
    /// in each. The blend is linear in the width.
    #[default]
    Blend,
    /// The coarsest level whose pixels are at most as wide as the footprint, with a kernel of the
    /// footprint's width: one to two pixels.
    One,
    /// Level 0 with a kernel of the footprint's width. The cost grows with the footprint's area.
    Base,
}

names!(LevelChoice, "choice of levels" {
    Blend = "blend",
    One = "one",
    Base = "base",
});

/// The values outside the map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Border {
    /// Visibility 1 at every depth.
    #[default]
    Lit,
    /// Each pixel at the border repeats outwards without end.
    Clamp,
}

names!(Border, "border" {
    Lit = "lit",
    Clamp = "clamp",
});

/// The answer of a lookup that needs a tile which fails to load.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum OnError {
    /// The lookup returns the error, which names the tile.
    #[default]
    Fail,
    /// The tile counts as lit; the sampler counts it.
    Lit,
    /// The tile counts as dark; the sampler counts it.
    Dark,
}

names!(OnError, "answer to errors" {
    Fail = "fail",
    Lit = "lit",
    Dark = "dark",
});

/// Options of a [`Sampler`](crate::Sampler).
///
/// ```
/// use deepshadow::{Border, Filter, SamplerOptions};
/// let options = SamplerOptions::new(Filter::Gaussian).border(Border::Clamp);
/// assert_eq!((options.filter, options.anisotropy), (Filter::Gaussian, 16.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct SamplerOptions {
    /// The kernel.
    pub filter: Filter,
    /// The levels that lookups read.
    pub levels: LevelChoice,
    /// The values outside the map.
    pub border: Border,
    /// The largest ratio of an ellipse's axes, 1 to 64. A longer ellipse is widened to this ratio.
    pub anisotropy: f32,
    /// The answer of lookups that need a tile which fails to load.
    pub on_error: OnError,
}

impl Default for SamplerOptions {
    /// Triangle, two levels blended, lit outside, ellipses up to 16 : 1, errors returned.
    fn default() -> Self {
        SamplerOptions {
            filter: Filter::default(),
            levels: LevelChoice::default(),
            border: Border::default(),
            anisotropy: 16.0,
            on_error: OnError::default(),
        }
    }
}

impl SamplerOptions {
    /// The default options with another filter.
    pub fn new(filter: Filter) -> Self {
        SamplerOptions {
            filter,
            ..SamplerOptions::default()
        }
    }

    /// Sets the kernel.
    pub fn filter(mut self, filter: Filter) -> Self {
        self.filter = filter;
        self
    }

    /// Sets the levels that lookups read.
    pub fn levels(mut self, levels: LevelChoice) -> Self {
        self.levels = levels;
        self
    }

    /// Sets the values outside the map.
    pub fn border(mut self, border: Border) -> Self {
        self.border = border;
        self
    }

    /// Sets the largest ratio of an ellipse's axes, 1 to 64.
    pub fn anisotropy(mut self, most: f32) -> Self {
        self.anisotropy = most;
        self
    }

    /// Sets the answer of lookups that need a tile which fails to load.
    pub fn on_error(mut self, on_error: OnError) -> Self {
        self.on_error = on_error;
        self
    }
}
