//! Options for the name and the attributes of a map, shared by dsm-convert and dsm-join.

use clap::{ArgAction, Args};
use deepshadow::{Attribute, MapHeader};

/// Most bytes of a name.
const MAX_NAME: usize = 255;

/// The name of a map and its attributes.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Description of the map")]
pub struct Label {
    /// Name of the map
    #[arg(long, value_parser = name)]
    pub name: Option<String>,
    /// Attribute of the map: an integer, a number, or text; may be repeated
    #[arg(
        long,
        num_args = 2,
        value_names = ["NAME", "VALUE"],
        action = ArgAction::Append,
        allow_hyphen_values = true
    )]
    pub attrib: Option<Vec<String>>,
}

impl Label {
    /// Writes the name and the attributes into `header`.
    pub fn describe(&self, header: &mut MapHeader) {
        if let Some(name) = &self.name {
            header.name.clone_from(name);
        }
        let words: Vec<_> = self.attrib.iter().flatten().collect();
        for pair in words.chunks_exact(2) {
            header.attributes.retain(|(name, _)| name != pair[0]);
            let value = attribute(pair[1]);
            header.attributes.push((pair[0].clone(), value));
        }
    }
}

/// Parses the name of a map.
fn name(text: &str) -> Result<String, String> {
    let fits = (1..=MAX_NAME).contains(&text.len()) && !text.chars().any(char::is_control);
    let reason = || format!("not 1 to {MAX_NAME} bytes long without control characters");
    fits.then(|| text.to_owned()).ok_or_else(reason)
}

/// Parses an attribute: an integer, else a finite number, else text.
fn attribute(value: &str) -> Attribute {
    let number = || value.parse().ok().filter(|v: &f64| v.is_finite());
    match (value.parse(), number()) {
        (Ok(integer), _) => Attribute::Integers(vec![integer]),
        (_, Some(number)) => Attribute::Numbers(vec![number]),
        _ => value.into(),
    }
}
