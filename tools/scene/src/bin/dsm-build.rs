//! The program `dsm-build`; all of it is in `deepshadow_scene::program`.

fn main() -> std::process::ExitCode {
    deepshadow_frame::exit("dsm-build", deepshadow_scene::program::run())
}
