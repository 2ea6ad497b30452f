//! Tests that loaders reject broken files with one line that names the file and the place.

use crate::load_support::*;
use deepshadow_scene::load::{self, RawShape};

/// Asserts that the error contains `words`.
fn says(ending: &str, bytes: impl AsRef<[u8]>, words: &str) {
    let line = refused(ending, bytes.as_ref());
    assert!(line.contains(words), "{ending}: {line}\nexpected: {words}");
}

fn replaced(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "{from:?} is not in the file");
    text.replace(from, to)
}

/// Replaces the bytes at `at`.
fn patched(mut bytes: Vec<u8>, at: usize, with: &[u8]) -> Vec<u8> {
    bytes[at..at + with.len()].copy_from_slice(with);
    bytes
}

#[test]
fn a_file_must_exist_and_have_a_known_ending() {
    let missing = load::object("/nowhere/at-all.obj".as_ref(), None).unwrap_err();
    let missing = missing.to_string();
    assert!(missing.starts_with("/nowhere/at-all.obj: "), "{missing}");
    says("txt", "", "known are .obj .ply .ply.gz .hair .tfx");
    says("gz", "", "known are");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("folder.obj");
    std::fs::create_dir(&path).unwrap();
    let line = load::object(&path, None).unwrap_err().to_string();
    assert!(line.contains("folder.obj: "), "{line}");
}

#[test]
fn only_a_raw_file_takes_a_shape_and_it_needs_one() {
    let shape: RawShape = "2x2x2:u8".parse().unwrap();
    let bare = load::object("a.raw".as_ref(), None).unwrap_err();
    assert!(
        bare.to_string().contains("needs the number of its samples"),
        "{bare}"
    );
    let twice = load::object("a.nii".as_ref(), Some(shape)).unwrap_err();
    assert!(twice.to_string().contains("only a .raw"), "{twice}");
    for (text, words) in [
        ("2x2x2", "64x64x93:u16"),
        ("2x2:u8", "WxHxD"),
        ("2x2x2x2:u8", "WxHxD"),
        ("2x2x-2:u8", "WxHxD"),
        ("2x2x99999999999:u8", "WxHxD"),
        ("2x2x2:u64", "type"),
        ("2x2x2:", "type"),
        ("2x2x2:u16bele", "type"),
    ] {
        let line = text.parse::<RawShape>().unwrap_err().to_string();
        assert!(line.contains(words), "{line}");
    }
}

#[test]
fn empty_files_are_refused() {
    for (ending, words) in [
        ("obj", "holds no faces"),
        ("ply", "does not begin"),
        ("ply.gz", "cannot be unpacked"),
        ("hair", "ends in its header"),
        ("tfx", "ends in its header"),
        ("raw", "take 24 bytes, and there are 0"),
        ("nrrd", "does not begin"),
        ("nii", "ends in its header"),
        ("nii.gz", "cannot be unpacked"),
        ("mhd", "without ElementDataFile"),
    ] {
        says(ending, "", words);
    }
}

#[test]
fn errors_in_obj_name_the_line() {
    says(
        "obj",
        "v 0 0 0\nv 1 0\n",
        "line 2: 2 numbers; 3 are expected",
    );
    says("obj", "v 0 x 0\n", "line 1: \"x\" is not a finite number");
    says(
        "obj",
        "v 0 nan 0\n",
        "line 1: \"nan\" is not a finite number",
    );
    says(
        "obj",
        "v 0 1e39 0\n",
        "line 1: \"1e39\" is not a finite number",
    );
    says("obj", "vt inf 0\n", "line 1: ");
    says("obj", b"v \xff\xfe 0 0\n", "line 1: ");
    let v = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    for (face, words) in [
        ("f 1 2", "line 4: a face of 2 corners"),
        (
            "f 1 2 4",
            "line 4: a face names vertex \"4\", and 3 were read so far",
        ),
        ("f 1 2 0", "names vertex \"0\""),
        ("f 1 2 -4", "names vertex \"-4\""),
        ("f 1 2 99999999999999999999", "names vertex"),
        (
            "f 1/1 2/1 3/1",
            "names texture coordinate \"1\", and 0 were",
        ),
        ("f 1 2 a", "names vertex \"a\""),
        ("f 1 1 2", "none of its 1 triangles has an area"),
        ("p 1", "holds no faces"),
    ] {
        says("obj", format!("{v}{face}\n"), words);
    }
}

#[test]
fn errors_in_ply_name_the_line_of_text_or_the_fault_of_binary() {
    let change = |from, to, words| says("ply", replaced(PLY, from, to), words);
    change("ply\n", "plx\n", "does not begin");
    change("ascii", "asci", "line 2: the format \"asci\" is not known");
    change("format ascii 1.0\n", "", "the header names no format");
    change("vertex 4", "vertex four", "line 4: \"four\" is not a count");
    change(
        "property uchar red",
        "property byte red",
        "line 5: the type \"byte\"",
    );
    change(
        "element vertex 4\n",
        "",
        "a property before the first element",
    );
    change(
        "element vertex",
        "elephant vertex",
        "\"elephant\" is not understood",
    );
    change(
        "property double z\n",
        "property double w\n",
        "no x, y and z",
    );
    change("vertex_indices", "corners", "no list vertex_indices");
    change("element face", "element facet", "holds no faces");
    change("element vertex", "element vortex", "holds no vertices");
    change("9 0.5 1", "9 a 1", "line 20: \"a\" is not a number for z");
    change("9 0.5 1", "9 inf 1", "vertex 3 is not at a finite place");
    change("1 1 1 1", "1 1 nan 1", "texture coordinate of vertex 3");
    change(
        "3 4 0 1 2 3",
        "3 4 0 1 2 4",
        "names vertex 4 (counted from 0), and there are 4",
    );
    change(
        "3 4 0 1 2 3",
        "3 4 0 1 2 -1",
        "line 23: vertex_indices is -1",
    );
    change(
        "3 4 0 1 2 3",
        "3 4 0 1 2 1.5",
        "line 23: vertex_indices is 1.5",
    );
    change("3 4 0 1 2 3", "3 400000 0 1 2", "more than the file holds");
    change(
        "3 4 0 1 2 3",
        "3 4 0 1 2",
        "the file ends before vertex_indices",
    );
    change("3 4 0 1 2 3", "3 4 0 0 1 1", "has an area");
    change("end_header", "", "");
    change(
        "element edge",
        "element vertex",
        "line 11: a second element \"vertex\"",
    );
    // Counts beyond the file, for elements that are read, skipped, or empty.
    change(
        "vertex 4",
        "vertex 1099511627776",
        "1099511627776 of element vertex take",
    );
    change(
        "vertex 4",
        "vertex 18446744073709551615",
        "of element vertex take",
    );
    change("edge 1", "edge 1099511627776", "of element edge take");
    change("face 1", "face 1099511627776", "of element face take");
    let nothing = replaced(
        PLY,
        "element face",
        "element nothing 18446744073709551615\nelement face",
    );
    assert!(load_as("ply", nothing.as_bytes()).is_ok());

    let binary = ply_binary(false);
    says(
        "ply",
        &binary[..binary.len() - 1],
        "vertex_indices is 4, more than the file holds",
    );
    let many = String::from_utf8_lossy(&binary).find("vertex 4").unwrap();
    says(
        "ply",
        patched(binary, many, b"vertex 9"),
        "9 of element vertex take 225 bytes",
    );
}

#[test]
fn a_packed_file_unpacks_only_up_to_a_limit() {
    let zeros = vec![b' '; 8 << 20];
    says(
        "ply.gz",
        gzip(&[PLY.as_bytes(), &zeros].concat()),
        "unpack to more than",
    );
    let packed = gzip(PLY.as_bytes());
    says("ply.gz", &packed[..packed.len() - 1], "cannot be unpacked");
    says("ply.gz", PLY, "not a .ply.gz file, but a PLY mesh");
    // Bytes after the samples of a volume are never unpacked.
    let long = gzip(&[nifti(false), zeros].concat());
    assert!(load_as("nii.gz", &long).is_ok());
}

#[test]
fn hair_that_contradicts_itself_is_refused() {
    let good = hair(&[2, 3, 4], true);
    let change = |at, with: &[u8], words| says("hair", patched(good.clone(), at, with), words);
    change(0, b"HAIM", "does not begin with HAIR");
    change(4, &u32::MAX.to_le_bytes(), "the file ends in its segments");
    change(
        4,
        &2u32.to_le_bytes(),
        "2 strands of 5 points in all, and the header says 9",
    );
    change(8, &8u32.to_le_bytes(), "the header says 8 points");
    change(12, &5u32.to_le_bytes(), "the flags are 0x5");
    change(12, &(7u32 | 64).to_le_bytes(), "the flags are 0x47");
    change(
        134,
        &f32::NAN.to_le_bytes(),
        "point 1 of strand 1 is not at a finite place",
    );
    change(134 + 9 * 12, &(-1f32).to_le_bytes(), "strand 1 is -1 wide");
    says(
        "hair",
        &good[..good.len() - 1],
        "the file ends in its thickness",
    );
    says("hair", &good[..150], "the file ends in its points");
    says(
        "hair",
        hair(&[1, 1], false),
        "none of its 2 strands has two points",
    );
    says("hair", hair(&[], false), "holds no strands");
    let still = patched(hair(&[2, 2], false), 132, &[0; 48]);
    says("hair", still, "none of its 2 strands has a length");
    // All strands have the header's length, 2^64 points in all.
    let mut endless = hair(&[2], false);
    endless[12] = 2;
    let endless = patched(endless, 4, &u32::MAX.to_le_bytes());
    says(
        "hair",
        patched(endless, 16, &u32::MAX.to_le_bytes()),
        "in all, and the header says 2",
    );
}

#[test]
fn tfx_that_announces_more_than_it_holds_is_refused() {
    let good = tfx(2, 3);
    let change = |at, with: &[u8], words| says("tfx", patched(good.clone(), at, with), words);
    change(0, &3f32.to_le_bytes(), "version 3 of TressFX");
    change(
        4,
        &3u32.to_le_bytes(),
        "the file ends in its points: 144 bytes from byte 160 on, and there are 96",
    );
    change(4, &u32::MAX.to_le_bytes(), "the file ends in its points");
    change(8, &u32::MAX.to_le_bytes(), "the file ends in its points");
    change(
        12,
        &159u32.to_le_bytes(),
        "begin at byte 159, in the header",
    );
    change(12, &u32::MAX.to_le_bytes(), "the file ends in its points");
    change(
        164,
        &f32::INFINITY.to_le_bytes(),
        "point 1 of strand 1 is not at a finite place, but at (0, inf, 2)",
    );
    change(4, &0u32.to_le_bytes(), "holds no strands");
    change(8, &0u32.to_le_bytes(), "holds no strands");
    change(
        8,
        &1u32.to_le_bytes(),
        "none of its 2 strands has two points",
    );
}

#[test]
fn a_raw_file_is_exactly_as_long_as_its_shape() {
    let read = |shape: &str, bytes: &[u8]| {
        let shape = shape.parse().unwrap();
        load::raw::parse(bytes, shape).unwrap_err().to_string()
    };
    assert!(
        read("2x2x2:u8", &[0; 7]).contains("2 x 2 x 2 samples of u8 take 8 bytes, and there are 7")
    );
    assert!(read("2x2x2:u8", &[0; 9]).contains("and there are 9"));
    assert!(read("2x2x1:u8", &[0; 4]).contains("at least along each axis"));
    assert!(read("0x2x2:u8", &[]).contains("at least along each axis"));
    assert!(read("10240x10240x10240:u8", &[0; 4]).contains("and there are 4"));
    assert!(read("65536x65536x65536:f64", &[0; 4]).contains("samples is too large"));
    assert!(read("4294967295x4294967295x4294967295:f64", &[0; 4]).contains("samples is too large"));
    let mut floats = vec![0; 32];
    floats[20..24].copy_from_slice(&f32::NAN.to_le_bytes());
    assert!(read("2x2x2:f32", &floats).contains("the sample at 1, 0, 1 is NaN"));
    let huge = f64::MAX.to_le_bytes().repeat(8);
    assert!(read("2x2x2:f64", &huge).contains("the sample at 0, 0, 0 is inf"));
}

#[test]
fn errors_in_nrrd_name_the_line() {
    let plain = "encoding: raw\nendian: little\n";
    let with = |fields: &str, words: &str| {
        says(
            "nrrd",
            nrrd(&format!("{plain}{fields}"), &samples(false)),
            words,
        );
    };
    with("type: block\n", "line 8: samples of type \"block\"");
    with("type: longlong\n", "line 8: samples of type \"longlong\"");
    with(
        "dimension: 4\nsizes: 3 2 3 2\n",
        "4 axes of [3, 2, 3, 2] samples",
    );
    with("sizes: 2 3\n", "3 axes of [2, 3] samples");
    with(
        "sizes: 2 3 -2\n",
        "line 8: sizes \"2 3 -2\" is not understood",
    );
    with("sizes: 2 3 1\n", "at least along each axis");
    with("sizes: 2 3 200\n", "take 2400 bytes, and there are 24");
    with("sizes: 65536 65536 65536\n", "samples is too large");
    with("sizes: 18446744073709551615 3 2\n", "samples is too large");
    with(
        "encoding: bzip2\n",
        "line 8: the encoding \"bzip2\"; raw, gzip and text",
    );
    with("endian: middle\n", "line 8: endian \"middle\"");
    with("spacings: 1 2\n", "spacing of 2 axes");
    with("spacings: 1 2 0\n", "spacing of 1 x 2 x 0");
    with("spacings: 1 2 inf\n", "spacing of 1 x 2 x inf");
    with(
        "space directions: (1,0,0) (0,1,0) 3\n",
        "line 8: space directions",
    );
    with(
        "space directions: (1,0,0) (0,nan,0) (0,0,1)\n",
        "line 8: space directions",
    );
    with("data file: LIST\n", "line 8: samples in several files");
    with(
        "data file: a%03d.raw 1 9 1\n",
        "line 8: samples in several files",
    );
    with("line skip: 3\n", "3 lines are to be left out");
    with(
        "byte skip: 100\n",
        "the file ends in its bytes to leave out",
    );
    with("byte skip: -1\nencoding: gzip\n", "stored plainly");
    with("byte skip: -2\n", "line 8: byte skip \"-2\"");
    with("gibberish\n", "line 8: \"gibberish\" is not a field");
    says("nrrd", nrrd("endian: little\n", b""), "has no encoding");
    says("nrrd", nrrd("encoding: raw\n", b""), "has no endian");
    says("nrrd", "NRRD0004\nencoding: raw\n", "has no type");
    says(
        "nrrd",
        nrrd("encoding: gzip\nendian: big\n", b"plain"),
        "cannot be unpacked",
    );
    says(
        "nrrd",
        nrrd("encoding: ascii\n", b"1 2 3 4 5 6 7 8 9 10 11 x"),
        "line 1: \"x\" is not a number",
    );
    says(
        "nrrd",
        nrrd("encoding: ascii\n", b"1 2 3"),
        "do not fit into 5 bytes",
    );
    says(
        "nrrd",
        nrrd("encoding: ascii\n", b"1 2 3 4 5 6 7 8 9 10 11 nan"),
        "is NaN",
    );
}

#[test]
fn errors_in_nifti_name_the_expected_value() {
    let good = nifti(false);
    let change = |at, with: &[u8], words| says("nii", patched(good.clone(), at, with), words);
    change(0, &540u32.to_le_bytes(), "NIfTI-2");
    change(0, &7u32.to_le_bytes(), "begins with 7, not with 348");
    change(344, b"ni1", "another file");
    change(344, b"abc", "does not have the magic");
    change(40, &2u16.to_le_bytes(), "2 axes of [2, 3] samples");
    change(40, &9u16.to_le_bytes(), "9 axes");
    change(42, &0u16.to_le_bytes(), "at least along each axis");
    change(42, &(-3i16).to_le_bytes(), "samples of u16 take");
    change(42, &[255, 255, 255, 255, 255, 255], "samples is too large");
    change(70, &128u16.to_le_bytes(), "NIfTI type 128");
    change(108, &0f32.to_le_bytes(), "begin at byte 0");
    change(108, &f32::NAN.to_le_bytes(), "begin at byte NaN");
    change(108, &1e30f32.to_le_bytes(), "not after the header");
    change(108, &4000f32.to_le_bytes(), "the file ends in its header");
    change(80, &f32::INFINITY.to_le_bytes(), "spacing of inf");
    change(112, &1e38f32.to_le_bytes(), "which is not a finite number");
    says(
        "nii",
        &good[..good.len() - 1],
        "take 24 bytes, and there are 23",
    );
    let big = patched(nifti(true), 40, &[0, 4, 0, 2, 0, 3, 0, 2, 0, 2]);
    says("nii", big, "4 axes of [2, 3, 2, 2] samples");
    // The size that a packed header announces is not allocated in advance.
    let forged = patched(good.clone(), 42, &[0, 32, 0, 32, 0, 32]);
    says(
        "nii.gz",
        gzip(&forged),
        "8192 x 8192 x 8192 samples of u16 take 1099511627776 bytes, and there are 24",
    );
}

#[test]
fn errors_in_metaimage_name_the_line() {
    let with = |fields: &str, words: &str| says("mha", mha(fields, &samples(false)), words);
    with("NDims = 2\n", "line 6: \"2\" axes");
    with(
        "DimSize = 2 3\n",
        "line 6: DimSize \"2 3\" is not understood",
    );
    with("DimSize = 2 3 9\n", "take 108 bytes, and there are 24");
    with("DimSize = 65536 65536 65536\n", "samples is too large");
    with("ElementSpacing = 1 1 -1\n", "spacing of 1 x 1 x -1");
    with(
        "ElementType = MET_LONG\n",
        "line 6: samples of type \"MET_LONG\"",
    );
    with(
        "ElementNumberOfChannels = 3\n",
        "line 6: samples of several numbers",
    );
    with(
        "BinaryDataByteOrderMSB = perhaps\n",
        "line 6: BinaryDataByteOrderMSB",
    );
    with(
        "HeaderSize = 4\nCompressedData = True\n",
        "HeaderSize together with",
    );
    with("CompressedData = True\n", "cannot be unpacked");
    with(
        "HeaderSize = 25\n",
        "the file ends in its bytes to leave out",
    );
    with(
        "ElementDataFile = LIST\n",
        "line 6: samples in several files",
    );
    with("gibberish\n", "line 6: \"gibberish\" is not a field");
    says("mhd", "ElementDataFile = a.raw\n", "has no ElementType");
}

#[test]
fn errors_in_transfer_functions_name_the_line() {
    let read = |text: &str| load::transfer::parse(text.as_bytes());
    let function = read("\n# bone\n 100 0 # nothing\r\n200\t1 2 3\n200 4\n").unwrap();
    assert_eq!(function.at(150.0), [0.5, 1.0, 1.5]);
    assert_eq!(function.at(200.0), [4.0; 3]);
    for (text, words) in [
        ("", "at least one point"),
        ("# nothing\n", "at least one point"),
        ("1\n", "line 1: 1 numbers"),
        ("1 2 3\n", "line 1: 3 numbers"),
        ("1 2 3 4 5\n", "line 1: 5 numbers"),
        (
            "1 2\n0 2\n",
            "line 2: the value 0 follows 1: values must ascend",
        ),
        ("1 2\n1 3\n1 4\n", "line 3: a third point at the value 1"),
        ("0 -1\n", "line 1: extinction -1"),
        ("0 nan\n", "line 1: extinction NaN"),
        ("inf 1\n", "line 1: the value inf"),
        ("0 x\n", "line 1: \"x\" is not a number"),
    ] {
        let line = read(text).unwrap_err().to_string();
        assert!(line.contains(words), "{line}\nexpected: {words}");
    }
}
