//! The fraction of a light that reaches a point, from one of four sources of shadows.
//!
//! | module | contents |
//! |---|---|
//! | [`mod@deep`] | from a deep shadow map |
//! | [`mod@exact`] | by shadow rays |
//! | [`mod@plain`] | from a plain shadow map, with percentage-closer filtering |

pub mod deep;
pub mod exact;
pub mod plain;

use deepshadow_frame::Result;
use deepshadow_scene::samples::Samples;

use crate::lamp::{Asked, Lamp};

/// A source of shadows.
#[derive(Debug)]
pub enum Shadows<'a> {
    /// No shadows.
    None,
    /// Lookups in a deep shadow map.
    Deep(deep::Deep),
    /// Shadow rays.
    Exact(exact::Exact<'a>),
    /// A plain shadow map.
    Plain(plain::Plain),
}

/// Samplers and buffers of one thread.
#[derive(Debug, Default)]
pub struct Asker {
    samplers: Vec<deep::LampSampler>,
    samples: Samples,
    march: Vec<(f32, [f32; 3])>,
}

impl Shadows<'_> {
    /// Makes the samplers and buffers of one thread.
    ///
    /// # Errors
    /// Those of the samplers of a deep map.
    pub fn asker(&self) -> Result<Asker> {
        let samplers = match self {
            Shadows::Deep(deep) => deep.samplers()?,
            _ => Vec::new(),
        };
        Ok(Asker {
            samplers,
            ..Asker::default()
        })
    }

    /// RGB fraction of light `number` that reaches a point.
    ///
    /// # Errors
    /// Those of lookups in a deep map.
    pub fn light(
        &self,
        asker: &mut Asker,
        lamp: &Lamp<'_>,
        number: usize,
        asked: &Asked,
    ) -> Result<[f32; 3]> {
        match self {
            Shadows::None => Ok([1.0; 3]),
            Shadows::Deep(_) => asker.samplers[number].light(asked),
            Shadows::Exact(exact) => Ok(exact.light(asker, lamp, number, asked)),
            Shadows::Plain(plain) => Ok([plain.light(asker, lamp, number, asked); 3]),
        }
    }
}
