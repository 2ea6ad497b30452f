//! The program `dsm-build`; all of it is in `deepshadow_build::program`.

fn main() -> std::process::ExitCode {
    deepshadow_cli::exit("dsm-build", deepshadow_build::program::run())
}
