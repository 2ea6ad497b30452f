//! The command line of `dsm-build`.

use std::path::{Path, PathBuf};

use clap::{Command, CommandFactory, Parser};
use deepshadow::{Compressor, Filter};
use deepshadow_frame::args::{Resolution, Running, region, three, with_defaults};
use deepshadow_frame::storage::{Base, Storage};
use deepshadow_frame::stream::is_standard_input;
use deepshadow_frame::{Failure, InFile, Result, choice, storage};

use crate::build::{Region, Settings};
use crate::error::{Error, ErrorKind};
use crate::scene::lamp::LampSpec;
use crate::scene::object::ObjectSpec;
use crate::scene::spec::Numbers;
use crate::scene::{Scene, file};

const LIGHT_HEADING: &str = "The light of one object";

/// Builds deep shadow maps from scenes of hair, meshes and volumes.
///
/// SCENE is a scene file (.toml) or one object: a mesh (.obj, .ply), curves (.hair, .tfx),
/// a volume (.raw with --shape, .nrrd, .nii, .mhd), or a demo such as demo:hairball.
/// One object gets one light: a directional light, or a spot light with --light-pos.
/// Every light of a scene becomes a map, a point light six.
///
/// SCENE may be - for a scene file from standard input, OUTPUT - for standard output. On an error,
/// OUTPUT does not appear.
#[derive(Debug, Parser)]
#[command(
    name = "dsm-build",
    version,
    verbatim_doc_comment,
    max_term_width = 100,
    allow_negative_numbers = true
)]
pub struct Args {
    /// A scene file, an object, or demo:NAME
    #[arg(value_name = "SCENE")]
    pub input: PathBuf,
    /// The .dsm file to write
    pub output: PathBuf,

    /// Direction in which a directional light travels [default: -0.4,-1,-0.3]
    #[arg(long, value_name = "X,Y,Z", value_parser = three, help_heading = LIGHT_HEADING)]
    pub light_dir: Option<[f64; 3]>,
    /// Position of a spot light
    #[arg(
        long,
        value_name = "X,Y,Z",
        value_parser = three,
        conflicts_with = "light_dir",
        help_heading = LIGHT_HEADING
    )]
    pub light_pos: Option<[f64; 3]>,
    /// Point at the centre of the map [default: the middle of the object]
    #[arg(long, value_name = "X,Y,Z", value_parser = three, help_heading = LIGHT_HEADING)]
    pub light_target: Option<[f64; 3]>,
    /// Angle of view of the spot light's map, over its shorter side [default: covers the object]
    #[arg(
        long,
        value_name = "DEGREES",
        requires = "light_pos",
        help_heading = LIGHT_HEADING
    )]
    pub light_angle: Option<f64>,

    /// Fraction of light that surfaces block: one number or three, 0 to 1 [default: 1]
    #[arg(long, value_name = "A|R,G,B", help_heading = "The object")]
    pub opacity: Option<Numbers<3>>,
    /// Width of all strands [default: the file's, or a thousandth of the object]
    #[arg(long, value_name = "W", help_heading = "The object")]
    pub width: Option<f64>,
    /// Number of samples of a .raw volume along x, y and z, such as 64x64x93
    #[arg(long, value_name = "WxHxD", help_heading = "The object")]
    pub shape: Option<String>,
    /// Type of the samples: u8 i8 u16 i16 u32 i32 f32 f64, with suffix be if big-endian [default:
    /// u8]
    #[arg(
        long = "type",
        value_name = "TYPE",
        requires = "shape",
        help_heading = "The object"
    )]
    pub kind: Option<String>,
    /// Transfer function of a volume: lines `value extinction` or `value red green blue` [default:
    /// from 0 at the least value to 1 at the greatest]
    #[arg(long, value_name = "FILE", help_heading = "The object")]
    pub transfer: Option<PathBuf>,
    /// Extinction per unit of length where the transfer function is 1: one number or three
    /// [default:
    /// 8 over the longest side]
    #[arg(long, value_name = "K|R,G,B", help_heading = "The object")]
    pub extinction: Option<Numbers<3>>,
    /// Distance between samples of a ray in a volume, in voxels [default: 1]
    #[arg(long, value_name = "VOXELS", help_heading = "The object")]
    pub step: Option<f64>,

    /// Pixels of a map: a side, or width and height [default: 512, or the scene's]
    #[arg(long, value_name = "N|WxH", help_heading = "Rays, for all lights")]
    pub resolution: Option<Resolution>,
    /// Rays per pixel, 1 to 4096 [default: 64, or the scene's]
    #[arg(long, value_name = "N", help_heading = "Rays, for all lights")]
    pub samples: Option<u32>,
    /// Filter of the rays around a pixel [default: box, or the scene's]
    #[arg(long, value_parser = choice(&Filter::ALL[1..]), help_heading = "Rays, for all lights")]
    pub filter: Option<Filter>,
    /// Width of the filter in pixels [default: 1, or the scene's]
    #[arg(long, value_name = "PIXELS", help_heading = "Rays, for all lights")]
    pub filter_width: Option<f64>,
    /// Seed of all random numbers [default: 0, or the scene's]
    #[arg(long, value_name = "S", help_heading = "Rays, for all lights")]
    pub seed: Option<u64>,

    /// Options for tolerance and tiles.
    #[command(flatten)]
    pub base: Base,
    /// Options for levels, vertices and compression.
    #[command(flatten)]
    pub storage: Storage,
    /// Build a part of every map: a rectangle of whole tiles; dsm-join stitch joins parts
    #[arg(long, value_name = "X,Y,W,H", value_parser = region, help_heading = "Precision and size")]
    pub region: Option<Region>,

    /// Print times, counts and sizes
    #[arg(long, help_heading = "Running")]
    pub runstats: bool,
    /// Options for threads and notes.
    #[command(flatten)]
    pub running: Running,
}

impl Args {
    /// The command with all defaults in its help.
    pub fn command() -> Command {
        let defaults = [
            (
                "tolerance",
                "0.25 over the square root of the samples, or the scene's",
            ),
            ("mip_tolerance", "the tolerance"),
            ("compressor", "lookahead"),
            ("compression", "zstd:15"),
            ("tile", "32"),
        ];
        with_defaults(<Args as CommandFactory>::command(), &defaults)
    }

    /// How maps are stored.
    ///
    /// # Errors
    /// `Usage` for values that are invalid for a map.
    pub fn settings(&self) -> Result<Settings> {
        let usual = Settings::default();
        Ok(Settings {
            tile: self.base.tile.unwrap_or(usual.tile),
            encoding: self
                .storage
                .encoding(storage::usual(Compressor::Lookahead))?,
            region: self.region,
            waiting: self.running.limits(1).memory as usize / 2,
        })
    }

    /// The scene that the arguments describe.
    ///
    /// # Errors
    /// `Usage` for invalid options, `Failed` for an error in a file.
    pub fn scene(&self) -> Result<Scene> {
        let is_scene = self
            .input
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("toml"))
            || is_standard_input(&self.input);
        let mut scene = if is_scene {
            self.scene_file()?
        } else {
            self.one_object()?
        };
        let resolution = self.resolution.map(|r| [r.width, r.height].map(f64::from));
        let said = LampSpec {
            resolution: resolution.map(Numbers),
            samples: self.samples,
            filter: self.filter,
            filter_width: self.filter_width,
            tolerance: self.base.tolerance,
            ..LampSpec::default()
        };
        for light in &mut scene.lights {
            said.settings(light).map_err(usage)?;
        }
        Ok(scene)
    }

    fn scene_file(&self) -> Result<Scene> {
        let said = [
            ("light-dir", self.light_dir.is_some()),
            ("light-pos", self.light_pos.is_some()),
            ("light-target", self.light_target.is_some()),
            ("opacity", self.opacity.is_some()),
            ("width", self.width.is_some()),
            ("shape", self.shape.is_some()),
            ("transfer", self.transfer.is_some()),
            ("extinction", self.extinction.is_some()),
            ("step", self.step.is_some()),
        ];
        if let Some((name, _)) = said.into_iter().find(|(_, given)| *given) {
            return Err(Failure::Usage(format!(
                "--{name}: applies only to a single object, not to a scene file"
            )));
        }
        let scene = file::read_with_seed(&self.input, self.seed)?;
        if scene.lights.is_empty() {
            return Err(Failure::Failed("a scene needs a [[light]]".into())).in_file(&self.input);
        }
        Ok(scene)
    }

    fn one_object(&self) -> Result<Scene> {
        let seed = self.seed.unwrap_or(0);
        let demo = self
            .input
            .to_str()
            .and_then(|i| i.strip_prefix("demo:"))
            .map(str::to_owned);
        let object = ObjectSpec {
            file: demo.is_none().then(|| self.input.clone()),
            demo,
            opacity: self.opacity,
            width: self.width,
            shape: self.shape.clone(),
            kind: self.kind.clone(),
            transfer: self.transfer.clone(),
            extinction: self.extinction,
            step: self.step,
            ..ObjectSpec::default()
        };
        let objects = object.objects(Path::new(""), seed).map_err(usage)?;
        let direction = self.light_dir.unwrap_or([-0.4, -1.0, -0.3]);
        let light = LampSpec {
            direction: self.light_pos.is_none().then_some(direction),
            position: self.light_pos,
            target: self.light_target,
            angle: self.light_angle,
            ..LampSpec::default()
        };
        Ok(Scene {
            objects,
            lights: vec![light.light().map_err(usage)?],
            camera: None,
            seed,
        })
    }
}

/// Converts an error in a setting to a wrong option, and every other error to a failure.
pub fn usage(e: Error) -> Failure {
    let option = match (e.kind(), e.key()) {
        (ErrorKind::Setting, None | Some("file" | "demo")) => {
            return Failure::Usage(e.message().into());
        }
        (ErrorKind::Setting, Some(key)) => match key {
            "direction" => "light-dir".into(),
            "position" => "light-pos".into(),
            "target" => "light-target".into(),
            "angle" => "light-angle".into(),
            key => key.replace('_', "-"),
        },
        _ => return e.into(),
    };
    Failure::Usage(format!("--{option}: {}", e.message()))
}
