//! The program `dsm-join`; all of it is in `deepshadow_cli::join`.

fn main() -> std::process::ExitCode {
    deepshadow_frame::exit("dsm-join", deepshadow_cli::join::run())
}
