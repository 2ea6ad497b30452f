//! The page: figures in order, each with a caption.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use deepshadow_frame::output::write_file;
use deepshadow_frame::{InFile, Result};
use deepshadow_render::image::Image;

const HEAD: &str = "# The figures of the paper, made anew

What Lokovic and Veach show in *Deep Shadow Maps* (SIGGRAPH 2000), with scenes of our own ([scenes/](scenes/)), maps by `dsm-build`, pictures by `dsm-render`. Everything
on this page is made by one command, numbers included: `cargo run --release -p deepshadow-figures`.

";

/// `figures.md` on its way.
#[derive(Debug)]
pub struct Page {
    folder: PathBuf,
    text: String,
}

impl Page {
    /// A page with its head.
    pub fn new(folder: &Path) -> Result<Self> {
        let pictures = folder.join("figures");
        std::fs::create_dir_all(&pictures).in_file(&pictures)?;
        Ok(Page {
            folder: folder.to_owned(),
            text: HEAD.into(),
        })
    }

    /// Begins a section.
    pub fn section(&mut self, title: &str) {
        println!("{title}");
        let _ = writeln!(self.text, "## {title}\n");
    }

    /// A paragraph, or a table.
    pub fn text(&mut self, text: &str) {
        println!("{text}");
        let _ = writeln!(self.text, "{}\n", text.trim_end());
    }

    /// Where a picture or plot called `name` goes; it is shown here.
    pub fn show(&mut self, name: &str, what: &str) -> PathBuf {
        let _ = writeln!(self.text, "![{what}](figures/{name})\n");
        self.folder.join("figures").join(name)
    }

    /// Shows pictures side by side.
    pub fn pictures(&mut self, name: &str, what: &str, pictures: &[&Image]) -> Result<()> {
        let path = self.show(name, what);
        side_by_side(pictures).write(&path)
    }

    /// Writes the page.
    pub fn write(self) -> Result<()> {
        let path = self.folder.join("figures.md");
        let text = format!("{}\n", self.text.trim_end());
        write_file(&path, text.as_bytes())
    }
}

/// One picture of several, with a white line between.
fn side_by_side(pictures: &[&Image]) -> Image {
    const LINE: u32 = 6;
    let height = pictures.iter().map(|p| p.height).max().unwrap_or(0);
    let width = pictures
        .iter()
        .map(|p| p.width + LINE)
        .sum::<u32>()
        .saturating_sub(LINE);
    let mut all = Image {
        width,
        height,
        pixels: vec![[1.0; 3]; (width * height) as usize],
    };
    let mut left = 0;
    for picture in pictures {
        for y in 0..picture.height {
            let row = (y * width + left) as usize;
            let from = (y * picture.width) as usize;
            let length = picture.width as usize;
            all.pixels[row..row + length].copy_from_slice(&picture.pixels[from..from + length]);
        }
        left += picture.width + LINE;
    }
    all
}
