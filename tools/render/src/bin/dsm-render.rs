//! The program `dsm-render`, implemented in `deepshadow_render`.

fn main() -> std::process::ExitCode {
    deepshadow_frame::exit("dsm-render", deepshadow_render::program::run())
}
