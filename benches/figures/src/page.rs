//! Writes the page `docs/figures.md`: the figures in order, each with a caption.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use deepshadow_frame::output::write_file;
use deepshadow_frame::{InFile, Result};
use deepshadow_render::image::Image;

const HEAD: &str = "# The figures of the paper, reproduced

The figures of Lokovic and Veach, *Deep Shadow Maps* (SIGGRAPH 2000), reproduced with our own scenes
([scenes/](scenes/)). `dsm-build` built the maps and `dsm-render` rendered the pictures. One command
makes this page with all its numbers: `cargo run --release -p deepshadow-figures`.

";

/// Columns at which paragraphs wrap.
const COLUMNS: usize = 100;

/// The text of `figures.md` so far, and the folder for it and its pictures.
#[derive(Debug)]
pub struct Page {
    folder: PathBuf,
    text: String,
}

impl Page {
    /// Starts a page with its introduction and creates the folder for its pictures.
    pub fn new(folder: &Path) -> Result<Self> {
        let pictures = folder.join("figures");
        std::fs::create_dir_all(&pictures).in_file(&pictures)?;
        Ok(Page {
            folder: folder.to_owned(),
            text: HEAD.into(),
        })
    }

    /// Starts a section.
    pub fn section(&mut self, title: &str) {
        println!("{title}");
        let _ = writeln!(self.text, "## {title}\n");
    }

    /// Appends a paragraph, wrapped at [`COLUMNS`].
    pub fn paragraph(&mut self, text: &str) {
        let mut wrapped = String::new();
        let mut column = 0;
        for word in text.split_whitespace() {
            let length = word.chars().count();
            if column == 0 {
                column = length;
            } else if column + 1 + length > COLUMNS {
                wrapped.push('\n');
                column = length;
            } else {
                wrapped.push(' ');
                column += 1 + length;
            }
            wrapped.push_str(word);
        }
        println!("{wrapped}");
        let _ = writeln!(self.text, "{wrapped}\n");
    }

    /// Appends a table.
    pub fn table(&mut self, table: &str) {
        println!("{table}");
        let _ = writeln!(self.text, "{}\n", table.trim_end());
    }

    /// Embeds the picture or plot `name` here. Returns the path to write it to.
    pub fn embed(&mut self, name: &str, what: &str) -> PathBuf {
        let _ = writeln!(self.text, "![{what}](figures/{name})\n");
        self.folder.join("figures").join(name)
    }

    /// Writes pictures side by side into one file and embeds it here.
    pub fn pictures(&mut self, name: &str, what: &str, pictures: &[&Image]) -> Result<()> {
        let path = self.embed(name, what);
        side_by_side(pictures).write(&path)
    }

    /// Writes `figures.md`.
    pub fn write(self) -> Result<()> {
        let path = self.folder.join("figures.md");
        let text = format!("{}\n", self.text.trim_end());
        write_file(&path, text.as_bytes())
    }
}

/// Joins pictures from left to right, with a white line between them.
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
