//! The program `dsm-info`; all of it is in `deepshadow_cli::info`.

fn main() -> std::process::ExitCode {
    deepshadow_cli::info::main(std::env::args_os())
}
