//! Files of other programs, if the folder of shared test data exists.

use crate::common::*;
use deepshadow_exr::*;

#[test]
fn valid_files_of_other_programs_are_read() {
    for path in data("deep-exr") {
        let reader = DeepReader::open(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let samples =
            read_everything(&reader).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        println!("{}: {samples} samples", path.display());
        let expected = match path.file_name().unwrap().to_str().unwrap() {
            "11.deep.exr" => 6_056,
            "42.deep.exr" => 67_605,
            "cortex_deepSmokeWithoutZBack.exr" => 116_004,
            "cortex_tiledDeepComplete.exr" => 1_247,
            "oiio_deepalpha.exr" => 28_846,
            "oiio_az_FLAT.exr" => 16,
            "v2_lowres_Balls.exr" => 162_877,
            _ => samples,
        };
        assert_eq!(samples, expected);
    }
}

#[test]
fn damaged_files_of_other_programs_are_refused_in_one_line() {
    for path in data("corrupt-exr") {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let started = std::time::Instant::now();
        let result = DeepReader::open(&path).and_then(|r| read_everything(&r));
        assert!(started.elapsed().as_secs() < 5, "{name} takes too long");
        match result {
            Ok(samples) => {
                println!("{name}: read, {samples} samples");
                // Their `type` is wrong, but only deep and multi-part files use it.
                let valid = [
                    "scanline_with_deepscanline_type.exr",
                    "tiled_with_deeptile_type.exr",
                ];
                assert!(valid.contains(&name.as_str()), "{name} was read");
            }
            Err(e) => {
                println!("{name}: {e}");
                assert_ne!(e.kind(), ErrorKind::Io);
                assert!(!e.to_string().contains('\n'));
            }
        }
    }
}
