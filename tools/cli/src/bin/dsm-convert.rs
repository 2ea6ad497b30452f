//! The program `dsm-convert`; all of it is in `deepshadow_cli::convert`.

fn main() -> std::process::ExitCode {
    deepshadow_frame::exit("dsm-convert", deepshadow_cli::convert::run())
}
