//! Files that the tests look at, and the program that looks.

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use deepshadow::{
    Attribute, Codec, Curve, DepthKind, Encoding, Group, GroupRole, Interpretation, MapHeader,
    MapId, Mips, Pixel, Pixels, TileId, Vertex, Visibility, Writer,
};
use serde_json::Value;
use tempfile::TempDir;

/// A folder with one file `f.dsm`.
pub struct Fixture {
    _folder: TempDir,
    pub path: PathBuf,
}

impl Fixture {
    /// A file that `write` fills.
    pub fn new(write: impl FnOnce(&mut Writer)) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("f.dsm");
        let mut writer = Writer::create(&path).unwrap();
        write(&mut writer);
        writer.finish().unwrap();
        Fixture {
            _folder: folder,
            path,
        }
    }

    /// A path beside the file.
    pub fn beside(&self, name: &str) -> PathBuf {
        self.path.with_file_name(name)
    }
}

pub fn exact() -> Encoding {
    Encoding::new(0.001).codec(Codec::Lz4).mips(Mips::Full)
}

/// Pixel (3, 4) of the map "key": a ramp, then a step. Stored as it is.
pub fn slab() -> Visibility {
    let points = [(1.0, 1.0), (2.0, 0.75), (3.0, 0.75), (3.0, 0.25)];
    Visibility::mono(points.map(|(z, v)| Vertex::new(z, v)).to_vec()).unwrap()
}

/// A mono map "key" of 40 x 20 with a slab and a wall, camera and attributes; a coloured map "fill"
/// of 8 x 8; a map "lit"; a group of each role.
pub fn rich() -> Fixture {
    Fixture::new(|w| {
        let mut key = MapHeader::new("key", 40, 20);
        (key.channels, key.tile_size) = (1, 16);
        (key.depth_kind, key.depth_unit) = (DepthKind::Planar, 0.01);
        key.interpretation = Interpretation::Continuous;
        let mut matrix = [0.0; 16];
        (0..4).for_each(|i| matrix[5 * i] = 1.0);
        matrix[14] = -7.5;
        key.camera.camera_from_world = Some(matrix);
        (key.data_origin, key.display_window) = ([-2, 5], [0, 0, 63, 31]);
        key.attributes = vec![
            ("Software".into(), "test \u{1b}[2J".into()),
            ("frames".into(), Attribute::Integers(vec![1, -2])),
            (
                "time".into(),
                Attribute::Opaque {
                    type_name: "exr:rational".into(),
                    bytes: vec![1, 2, 254],
                },
            ),
        ];
        let map = w.add_map(key, exact()).unwrap();
        let mut first = vec![Visibility::lit(); 256];
        first[4 * 16 + 3] = slab();
        w.tile(map, TileId::new(0, 0), Pixels::Functions(first))
            .unwrap();
        for x in 0..40 {
            let wall = Curve::mono(vec![5.0], vec![0.0]).unwrap();
            w.pixel(map, Pixel::new(x, 18), &wall).unwrap();
        }
        let mut fill = MapHeader::new("fill", 8, 8);
        fill.tile_size = 8;
        let flat = exact().mips(Mips::None);
        let map = w.add_map(fill, flat.clone()).unwrap();
        let glass = Curve::rgb(vec![-1.0, 2.0], vec![[1.0, 0.75, 0.5], [0.5, 0.25, 0.0]]).unwrap();
        w.pixel(map, Pixel::new(7, 0), &glass).unwrap();
        w.add_map(MapHeader::new("lit", 100, 1), flat).unwrap();
        for (name, role, maps) in [
            ("all", GroupRole::Clusters, vec![0, 1, 2]),
            ("cube", GroupRole::Faces, vec![2, 0]),
        ] {
            let maps = maps.into_iter().map(MapId).collect();
            w.add_group(Group::new(name, role, maps));
        }
        w.add_attribute("numbers", Attribute::Numbers(vec![0.5, f64::INFINITY]));
    })
}

/// A mono map "m" of 32 x 32 whose pixels in row 0 end at `v`.
pub fn wall(v: f64, change: impl FnOnce(&mut MapHeader, &mut Encoding)) -> Fixture {
    Fixture::new(|w| {
        let mut header = MapHeader::new("m", 32, 32);
        let mut encoding = exact();
        change(&mut header, &mut encoding);
        let map = w.add_map(header, encoding).unwrap();
        for x in 0..32 {
            w.pixel(
                map,
                Pixel::new(x, 0),
                &Curve::mono(vec![2.0 + x as f32], vec![v]).unwrap(),
            )
            .unwrap();
        }
    })
}

/// The program.
pub fn info() -> Command {
    Command::cargo_bin("dsm-info").unwrap()
}

/// Standard output of a run that goes well.
pub fn output(file: &Path, options: &[&str]) -> String {
    let run = info().args(options).arg(file).assert().success();
    assert!(run.get_output().stderr.is_empty());
    String::from_utf8(run.get_output().stdout.clone()).unwrap()
}

/// The JSON of a run that goes well.
pub fn json(file: &Path, options: &[&str]) -> Value {
    let options = [&["--json"], options].concat();
    serde_json::from_str(&output(file, &options)).unwrap()
}

/// Exit code, standard output, standard error, of which there is at most one line.
pub fn run(command: &mut Command) -> (i32, String, String) {
    let out = command.output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    let (stdout, stderr) = (text(out.stdout), text(out.stderr));
    assert!(stderr.lines().count() <= 1, "{stderr}");
    (out.status.code().unwrap(), stdout, stderr)
}
