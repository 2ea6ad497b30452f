//! Reads scene files: strict TOML, with the line of every error. `docs/scenes.md` describes them.

use std::ops::Range;
use std::path::Path;

use crate::error::{Error, ErrorKind, InFile, Result};
use deepshadow_frame::foreign::identify;
use deepshadow_frame::stream::Input;
use glam::DVec3;
use serde::Deserialize;
use toml::Spanned;

use super::lamp::LampSpec;
use super::object::ObjectSpec;
use super::spec::{FAR, Numbers, fault, finite};
use super::{PictureCamera, Scene};

/// Most bytes of a scene file. Scenes refer to large files by name.
const MAX_BYTES: u64 = 16 << 20;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SceneSpec {
    seed: Option<u64>,
    #[serde(default)]
    object: Vec<Spanned<ObjectSpec>>,
    #[serde(default)]
    light: Vec<Spanned<LampSpec>>,
    camera: Option<Spanned<CameraSpec>>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraSpec {
    position: [f64; 3],
    target: [f64; 3],
    up: Option<[f64; 3]>,
    angle: Option<f64>,
    resolution: Option<Numbers<2>>,
}

/// Reads a scene file and all files that it names.
///
/// # Errors
/// One line: the scene file, the line, the key and the problem; or a file that the scene names, and
/// its problem.
pub fn read(path: &Path) -> Result<Scene> {
    read_with_seed(path, None)
}

/// As [`read`], with a seed that overrides the file's.
///
/// # Errors
/// As [`read`].
pub fn read_with_seed(path: &Path, seed: Option<u64>) -> Result<Scene> {
    let text = text(path).in_file(path)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    parse(&text, path, folder, seed)
}

fn text(path: &Path) -> Result<String> {
    let bytes = Input::open(path)?
        .bytes(MAX_BYTES)
        .map_err(|e| match e.kind() {
            std::io::ErrorKind::FileTooLarge => Error::new(
                ErrorKind::Scene,
                format!("a scene file has at most {MAX_BYTES} bytes"),
            ),
            _ => e.into(),
        })?;
    String::from_utf8(bytes).map_err(|e| {
        let kind = identify(e.as_bytes());
        let kind = kind.map_or("of an unknown kind".into(), |kind| format!("but {kind}"));
        let line = format!("not a scene, which is a text file in TOML, {kind}");
        Error::new(ErrorKind::Scene, line)
    })
}

fn parse(text: &str, path: &Path, folder: &Path, seed: Option<u64>) -> Result<Scene> {
    let spec: SceneSpec = toml::from_str(text).map_err(|e| {
        let at = e.span().map_or(0, |s| s.start);
        let line = line_of(text, at);
        let message = explained(text, line, e.message());
        Error::new(ErrorKind::Scene, message).at_line(path, line, "scene")
    })?;
    let seed = seed.or(spec.seed).unwrap_or(0);
    let mut scene = Scene {
        seed,
        ..Scene::default()
    };
    for object in &spec.object {
        let here = |e| at_key_line(e, text, path, object.span(), "object");
        scene
            .objects
            .extend(object.get_ref().objects(folder, seed).map_err(here)?);
    }
    for light in &spec.light {
        let here = |e| at_key_line(e, text, path, light.span(), "light");
        let made = light.get_ref().light().map_err(here)?;
        if scene.lights.iter().any(|l| l.name == made.name) {
            let twice = format!("two lights are called {:?}", made.name);
            return Err(here(Error::of_key("name", twice)));
        }
        scene.lights.push(made);
    }
    if let Some(camera) = &spec.camera {
        let made = camera.get_ref().camera();
        scene.camera = Some(made.map_err(|e| at_key_line(e, text, path, camera.span(), "camera"))?);
    }
    if scene.objects.is_empty() {
        return Err(
            Error::new(ErrorKind::Scene, "a scene needs an [[object]]").at_line(path, 1, "scene")
        );
    }
    Ok(scene)
}

impl CameraSpec {
    fn camera(&self) -> Result<PictureCamera> {
        let point = |key, p: [f64; 3]| finite(key, p, -FAR..=FAR).map(DVec3::from_array);
        let resolution = self.resolution.map_or([512.0; 2], |r| r.0);
        if resolution
            .iter()
            .any(|r| !(1.0..=32768.0).contains(r) || r.fract() != 0.0)
        {
            return fault("resolution", "it is not 1 to 32768 pixels");
        }
        let camera = PictureCamera {
            position: point("position", self.position)?,
            target: point("target", self.target)?,
            up: self.up.map_or(Ok(DVec3::Y), |up| point("up", up))?,
            angle: finite("angle", [self.angle.unwrap_or(40.0)], 0.001..=179.0)?[0],
            resolution: resolution.map(|r| r as u32),
        };
        if camera.position == camera.target {
            return fault("target", "it is the position of the camera");
        }
        Ok(camera)
    }
}

/// Number of the line that contains a byte.
fn line_of(text: &str, at: usize) -> usize {
    1 + text.as_bytes()[..at.min(text.len())]
        .iter()
        .filter(|b| **b == b'\n')
        .count()
}

/// Formats a parser's message in one line: adds the key, and for an unknown key the most similar
/// known key.
fn explained(text: &str, line: usize, message: &str) -> String {
    let message = message.lines().map(str::trim).collect::<Vec<_>>().join(" ");
    let key = text.lines().nth(line - 1).and_then(|l| l.split_once('='));
    let key = key
        .map(|(key, _)| key.trim())
        .filter(|k| !k.is_empty() && !message.contains(*k));
    let about = key.map_or(message.clone(), |key| format!("{key}: {message}"));
    let mut names = message.split('`').skip(1).step_by(2);
    let Some(unknown) = names.next().filter(|_| message.starts_with("unknown ")) else {
        return about;
    };
    let near = |name: &&str| strsim::damerau_levenshtein(unknown, name);
    match names
        .min_by_key(near)
        .filter(|n| near(n) <= 2 + unknown.len() / 4)
    {
        Some(name) => format!("unknown key `{unknown}`: did you mean `{name}`?"),
        None => about,
    }
}

/// Places the error of a key at the line of that key in its table. Other errors stay unchanged.
fn at_key_line(e: Error, text: &str, path: &Path, table: Range<usize>, kind: &str) -> Error {
    let Some(key) = e.key() else {
        return e;
    };
    let first = line_of(text, table.start);
    let lines = text.lines().enumerate().skip(first - 1);
    let own = lines.take_while(|(i, l)| *i + 1 == first || !l.trim_start().starts_with('['));
    let line = own
        .filter(|(_, l)| l.split_once('=').is_some_and(|(k, _)| k.trim() == key))
        .map(|(i, _)| i + 1)
        .next();
    e.at_line(path, line.unwrap_or(first), kind)
}
