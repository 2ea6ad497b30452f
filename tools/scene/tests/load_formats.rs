//! Tests the results of loaders for valid files: small ones made here, and real ones.

use std::path::Path;

use crate::load_support::*;
use deepshadow_scene::geometry::{Curves, Mesh, bounds};
use deepshadow_scene::load::{self, Loaded, RawShape};
use glam::Vec3;

fn mesh(ending: &str, bytes: &[u8]) -> Mesh {
    match load_as(ending, bytes).unwrap() {
        Loaded::Mesh(mesh) => mesh,
        other => panic!("{other:?}"),
    }
}

fn curves(ending: &str, bytes: &[u8]) -> Curves {
    match load_as(ending, bytes).unwrap() {
        Loaded::Curves(curves) => curves,
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_square_is_the_same_in_every_mesh_format() {
    let square = mesh("obj", OBJ.as_bytes());
    assert_eq!(square.positions[0][2], Vec3::new(1.0, 1.0, 0.5));
    assert_eq!(square.triangles, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(square.uvs[2], [1.0, 1.0]);
    assert_eq!(mesh("ply", PLY.as_bytes()), square);
    assert_eq!(mesh("ply", PLY.replace('\n', "\r\n").as_bytes()), square);
    assert_eq!(mesh("ply", &ply_binary(false)), square);
    assert_eq!(mesh("ply", &ply_binary(true)), square);
    assert_eq!(mesh("ply.gz", &gzip(PLY.as_bytes())), square);
    assert_eq!(mesh("OBJ", OBJ.replace('\n', "\r\n").as_bytes()), square);
}

#[test]
fn faces_may_come_before_vertices_in_ply() {
    let text = "ply\nformat ascii 1.0\nelement face 1\nproperty list int int vertex_index\n\
    element vertex 3\n\
        property float x\nproperty float y\nproperty float z\nend_header\n3 0 1 2\n0 0 0\n\
        1 0 0\n0 1 0";
    assert_eq!(mesh("ply", text.as_bytes()).triangles, [[0, 1, 2]]);
}

#[test]
fn vertices_of_obj_with_equal_position_and_texture_coordinate_are_shared() {
    // Two adjacent triangles. The shared edge first has equal texture coordinates on other lines,
    // then different ones.
    let v = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\n";
    let seamless = format!(
        "{v}vt 0 0\nvt 1 0\nvt 0 1\nvt 1 0\nvt 0 1\nvt 1 1\nf 1/1 2/2 3/3\nf 2/4 4/6 3/5\n"
    );
    assert_eq!(mesh("obj", seamless.as_bytes()).positions[0].len(), 4);
    let seam = format!("{v}vt 0 0\nvt 1 0\nvt 0 1\nvt 0.5 0\nf 1/1 2/2 3/3\nf 2/4 4/2 3/3\n");
    assert_eq!(mesh("obj", seam.as_bytes()).positions[0].len(), 5);
    let bare = format!("{v}vt 0 0\nf 1 2 3\nf 2 4 3\n");
    let bare = mesh("obj", bare.as_bytes());
    assert_eq!((bare.positions[0].len(), bare.uvs.len()), (4, 0));
}

#[test]
fn obj_counts_from_the_end_and_joins_lines() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 \\\n-1\nv 5 5 5\nf 1 2 \\\r\n4 \\";
    let mesh = mesh("obj", text.as_bytes());
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 1, 3]]);
    assert_eq!(mesh.positions[0][3], Vec3::splat(5.0));
}

#[test]
fn triangles_without_area_are_dropped() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nf 1 2 3\nf 1 1 2\nf 1 2 4\n";
    assert_eq!(mesh("obj", text.as_bytes()).triangles, [[0, 1, 2]]);
}

#[test]
fn hair_takes_segments_and_widths_from_arrays_or_header() {
    let curves_of = |strands: &[u16], widths| curves("hair", &hair(strands, widths));
    let three = curves_of(&[2, 3, 4], true);
    assert_eq!(three.strands, [0, 2, 5, 9]);
    assert_eq!(three.points[0][1], Vec3::new(1.5, 2.0, 2.5));
    assert_eq!(three.widths, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]);
    // The strand of one point is dropped; widths come from the header.
    let two = curves_of(&[3, 1, 2], false);
    assert_eq!(two.strands, [0, 3, 5]);
    assert_eq!(two.points[0][3], Vec3::new(6.0, 6.5, 7.0));
    assert_eq!(two.widths, [0.25; 5]);

    // Without a segments array, the header gives five for each strand; there is no thickness
    // either.
    let mut bytes = hair(&[6, 6], false);
    bytes[12] = 2;
    bytes[20..24].copy_from_slice(&0f32.to_le_bytes());
    bytes.drain(128..132);
    let default = curves("hair", &bytes);
    assert_eq!((default.strands, default.widths), (vec![0, 6, 12], vec![]));
}

#[test]
fn points_that_repeat_the_previous_one_are_dropped_with_their_widths() {
    let mut bytes = hair(&[4], true);
    // The third point equals the second.
    let points = 128 + 2;
    bytes.copy_within(points + 12..points + 24, points + 24);
    let curves = curves("hair", &bytes);
    assert_eq!(curves.strands, [0, 3]);
    assert_eq!(curves.widths, [0.0, 1.0, 3.0]);
}

#[test]
fn tfx_points_are_the_first_three_of_four() {
    let curves = curves("tfx", &tfx(2, 3));
    assert_eq!(curves.strands, [0, 3, 6]);
    assert_eq!(curves.points[0][4], Vec3::new(16.0, 17.0, 18.0));
    assert!(curves.widths.is_empty());
}

#[test]
fn every_volume_format_gives_the_same_samples() {
    let expected: Vec<f32> = SAMPLES.iter().map(|&v| f32::from(v)).collect();
    for (ending, bytes) in files() {
        let Loaded::Volume(grid) = load_as(ending, &bytes).unwrap() else {
            continue;
        };
        assert_eq!(grid.size, [2, 3, 2], "{ending}");
        let (expected, spacing) = match ending {
            "nii" | "nii.gz" => (
                expected.iter().map(|v| v * 2.0 + 1.0).collect(),
                [0.5, 1.5, 2.0],
            ),
            "raw" => (expected.clone(), [1.0; 3]),
            _ => (expected.clone(), [0.5, 1.5, 2.0]),
        };
        assert_eq!(grid.values, expected, "{ending}");
        assert_eq!(grid.spacing, Vec3::from_array(spacing), "{ending}");
    }
}

#[test]
fn every_type_of_sample_is_read() {
    let shape = |kind: &str| RawShape::new("2x2x2", kind).unwrap();
    let read = |kind: &str, bytes: &[u8]| load::raw::parse(bytes, shape(kind)).unwrap().values[1];
    let second = |bytes: &[u8]| [vec![0; bytes.len()], bytes.repeat(7)].concat();
    assert_eq!(read("u8", &second(&[200])), 200.0);
    assert_eq!(read("i8", &second(&[200])), -56.0);
    assert_eq!(read("u16", &second(&[1, 255])), 65281.0);
    assert_eq!(read("i16le", &second(&[1, 255])), -255.0);
    assert_eq!(read("i16be", &second(&[255, 1])), -255.0);
    assert_eq!(read("u32be", &second(&[0, 0, 1, 2])), 258.0);
    assert_eq!(read("i32", &second(&[254, 255, 255, 255])), -2.0);
    assert_eq!(read("f32", &second(&1.5f32.to_le_bytes())), 1.5);
    assert_eq!(read("f64", &second(&(-2.5f64).to_le_bytes())), -2.5);
}

#[test]
fn samples_may_be_in_another_file_than_the_header() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let nhdr = nrrd(
        "endian: big\nencoding: raw\nbyte skip: -1\ndata file: voxels.bin\n",
        b"",
    );
    std::fs::write(at("a.nhdr"), nhdr).unwrap();
    let mhd = String::from_utf8(mha("ElementByteOrderMSB = True\nHeaderSize = -1\n", b"")).unwrap();
    std::fs::write(at("a.mhd"), mhd.replace("LOCAL", "voxels.bin")).unwrap();
    let missing = load::object(&at("a.nhdr"), None).unwrap_err().to_string();
    assert!(missing.contains("voxels.bin"), "{missing}");
    std::fs::write(at("voxels.bin"), [&b"header"[..], &samples(true)].concat()).unwrap();
    for name in ["a.nhdr", "a.mhd"] {
        let Loaded::Volume(grid) = load::object(&at(name), None).unwrap() else {
            panic!("{name}");
        };
        assert_eq!(grid.values[11], 1000.0, "{name}");
    }
    std::fs::write(at("voxels.bin"), b"short").unwrap();
    let short = load::object(&at("a.mhd"), None).unwrap_err().to_string();
    assert!(
        short.contains("voxels.bin: ") && short.contains("24 bytes"),
        "{short}"
    );
}

#[test]
fn frames_are_keys_of_one_object_and_lose_only_geometry_without_extent_at_any_key() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let faces = "f 1 2 3\nf 1 2 4\nf 1 1 2\n";
    let frame = |third: &str| format!("v 0 0 0\nv 1 0 0\nv {third}\nv 2 0 0\n{faces}");
    // The first triangle is flat at the first key, the others at both.
    let flat = file("a.obj", frame("3 0 0").as_bytes());
    let wide = file("b.obj", frame("0 1 0").as_bytes());
    let Loaded::Mesh(mesh) = load::frames(&[&flat, &wide], None).unwrap() else {
        panic!();
    };
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
    assert_eq!((mesh.positions.len(), mesh.positions[1][2]), (2, Vec3::Y));
    let alone = load::object(&flat, None).unwrap_err().to_string();
    assert!(
        alone.contains("none of its 3 triangles has an area"),
        "{alone}"
    );

    // The second point equals the first at the first key, the fourth equals the third at both.
    let strand = |patches: &[usize]| {
        let mut bytes = hair(&[4, 2], true);
        for &i in patches {
            let at = 132 + 12 * i;
            bytes.copy_within(at - 12..at, at);
        }
        bytes
    };
    let a = file("a.hair", &strand(&[1, 3]));
    let b = file("b.hair", &strand(&[3]));
    let Loaded::Curves(curves) = load::frames(&[&a, &b], None).unwrap() else {
        panic!();
    };
    assert_eq!(curves.strands, [0, 3, 5]);
    assert_eq!(curves.widths, [0.0, 1.0, 2.0, 4.0, 5.0]);
    assert_eq!(curves.points[0][0], curves.points[0][1]);
    assert_ne!(curves.points[1][0], curves.points[1][1]);
    assert_eq!(curves.points[0].len(), curves.points[1].len());

    let says = |frames: &[&Path], words: &str| {
        let line = load::frames(frames, None).unwrap_err().to_string();
        assert!(line.contains(words), "{line}");
    };
    says(&[], "no frames");
    says(
        &[&a, &flat],
        "a.obj: not the same kind of object as the first frame",
    );
    let square = file("square.obj", OBJ.as_bytes());
    says(
        &[&flat, &square],
        "square.obj: 4 vertices and 2 triangles that are not those of the first frame, 4 and 3",
    );
    let other = file("other.hair", &hair(&[2, 4], true));
    says(
        &[&a, &other],
        "other.hair: 2 strands that are not as long as the 2 of the first frame",
    );
    let volume = file("a.nii", &nifti(false));
    says(&[&volume, &volume], "a.nii: a volume cannot have frames");
}

fn name(path: &Path) -> String {
    path.file_name().unwrap().to_string_lossy().into_owned()
}

#[test]
fn real_meshes_have_the_vertices_and_faces_that_other_readers_find() {
    for path in data("mesh") {
        let (vertices, faces) = match name(&path).as_str() {
            "bunny_lowres.ply" => (453, 948),
            "bunny_nori.obj" => (1016, 2000),
            "dragon_vrip_res4.ply.gz" => (5205, 11102),
            "eztree_gen_oak_small.obj" => (9544, 6806),
            // As many as in the file; the other readers split vertices at every edge.
            "ico4.obj" => (642, 1280),
            "spot.obj" => (3225, 5856),
            "teapot.obj" => (3644, 6320),
            _ => continue,
        };
        let Loaded::Mesh(mesh) = load::object(&path, None).unwrap() else {
            panic!("{path:?}");
        };
        laws::laws(&Loaded::Mesh(mesh.clone()));
        let found = (mesh.positions[0].len(), mesh.triangles.len());
        println!("{}: {found:?}, of {:?}", path.display(), (vertices, faces));
        assert_eq!(found, (vertices, faces), "{path:?}");
    }
}

#[test]
fn real_strands_have_the_points_that_other_readers_find() {
    for path in data("curves") {
        let (strands, points, low, high) = match name(&path).as_str() {
            "Ratboy_mohawk.tfx" => (2228, 71296, [-0.095, 0.214, -0.336], [0.117, 1.11, 0.271]),
            "sintel_hair.tfx" => (
                228,
                7296,
                [-10.617, 20.716, -12.952],
                [9.827, 47.686, 11.656],
            ),
            _ => continue,
        };
        let loaded = load::object(&path, None).unwrap();
        laws::laws(&loaded);
        let Loaded::Curves(curves) = loaded else {
            panic!("{path:?}");
        };
        let (lo, hi) = bounds(&curves.points[0]).unwrap();
        assert!((lo - Vec3::from_array(low)).length() < 1e-3, "{lo}");
        assert!((hi - Vec3::from_array(high)).length() < 1e-3, "{hi}");
        assert_eq!(curves.strands.len() - 1, strands, "{path:?}");
        assert_eq!(curves.points[0].len(), points, "{path:?}");
    }
}

#[test]
fn real_volumes_have_the_sizes_and_ranges_that_other_readers_find() {
    for path in data("volume") {
        let (shape, size, step, range, mean) = match name(&path).as_str() {
            "Bucky_32x32x32_u8.raw" => (Some("32x32x32:u8"), [32; 3], 1.0, (0.0, 255.0), 35.85),
            "FLAIR.nii.gz" => (None, [124, 160, 140], 1.0, (0.0, 255.0), 41.486),
            "HeadMRVolume.mhd" => (None, [48, 62, 42], 4.0, (0.0, 255.0), 24.468),
            "HeadMRVolume.raw" => (Some("48x62x42:u8"), [48, 62, 42], 1.0, (0.0, 255.0), 24.468),
            "bonsai.nii.gz" => (None, [256; 3], 1.0, (0.0, 255.0), 13.465),
            "fuel.nii.gz" => (None, [64, 33, 32], 1.0, (0.0, 255.0), 7.5434),
            "headsq_quarter_64x64x93_u16le.raw" => (
                Some("64x64x93:u16"),
                [64, 64, 93],
                1.0,
                (0.0, 3926.0),
                507.69,
            ),
            "nibabel_anatomical.nii" => (None, [33, 41, 25], 2.0, (-610.0, 30393.0), 8401.1),
            _ => continue,
        };
        let loaded = load::object(&path, shape.map(|s| s.parse().unwrap())).unwrap();
        laws::laws(&loaded);
        let Loaded::Volume(grid) = loaded else {
            panic!("{path:?}");
        };
        let sum: f64 = grid.values.iter().map(|&v| f64::from(v)).sum();
        let found = sum / grid.values.len() as f64;
        println!(
            "{}: {:?}, {:?}, mean {found}",
            path.display(),
            grid.size,
            grid.range()
        );
        assert_eq!(grid.size, size, "{path:?}");
        assert_eq!(grid.range(), range, "{path:?}");
        assert_eq!(grid.spacing, Vec3::splat(step), "{path:?}");
        assert!((found - mean).abs() < 1e-3 * mean, "{path:?}: {found}");
    }
}
