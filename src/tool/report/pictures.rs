//! The figures of a report as files, one each.

use super::outputs;
use crate::report::{Figure, MapStyle};
use crate::stream::{Fault, WholeFile};
use std::path::{Path, PathBuf};

/// Pixels of a PNG for a pixel of the page.
const SCALE: f32 = 2.0;

/// Where figures go as files of their own.
#[derive(Clone, Debug, clap::Args)]
pub struct PictureArgs {
    /// Write each figure as an SVG file into a directory, which is made if need be (error-x.svg, ..)
    #[arg(long, value_name = "DIR")]
    pub svg: Option<PathBuf>,
    /// Write each figure as a PNG file into a directory, which is made if need be
    #[arg(long, value_name = "DIR")]
    pub png: Option<PathBuf>,
}

/// How maps are drawn.
pub(super) fn parse_maps(text: &str) -> Result<MapStyle, String> {
    match text {
        "cells" => Ok(MapStyle::Cells),
        "contours" => Ok(MapStyle::Contours),
        "both" => Ok(MapStyle::Both),
        _ => Err("cells, contours or both is wanted".to_owned()),
    }
}

impl PictureArgs {
    /// Whether any figure is wanted.
    pub(super) fn wanted(&self) -> bool {
        self.svg.is_some() || self.png.is_some()
    }

    /// Writes every figure wherever it is wanted.
    pub(super) fn write(&self, figures: &[Figure]) -> anyhow::Result<()> {
        if let Some(folder) = &self.svg {
            into(folder, figures, "svg", |f| Ok(f.svg().into_bytes()))?;
        }
        if let Some(folder) = &self.png {
            into(folder, figures, "png", |f| {
                let png = f.png(SCALE);
                png.map_err(|e| Fault::BadData(format!("{}: {e}", f.name)).into())
            })?;
        }
        Ok(())
    }
}

fn into(
    folder: &Path,
    figures: &[Figure],
    ending: &str,
    bytes: impl Fn(&Figure) -> anyhow::Result<Vec<u8>>,
) -> anyhow::Result<()> {
    outputs::folder(folder)?;
    for figure in figures {
        let path = folder.join(format!("{}.{ending}", figure.name));
        WholeFile::open(Some(&path))?.finish(bytes(figure)?)?;
    }
    Ok(())
}
