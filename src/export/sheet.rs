//! Contact sheets: several images with labels as one.

use super::{Image, font};
use crate::error::{Error, Result};

/// One image of a sheet.
#[derive(Clone, Copy, Debug)]
pub struct Tile<'a> {
    /// The image; alpha is laid over the background.
    pub image: &'a Image,
    /// What stands under it; may be empty; long lines are broken at spaces.
    pub label: &'a str,
}

/// How a sheet looks. Lengths in pixels, colours linear Rec.709 with alpha.
#[derive(Clone, Debug)]
pub struct SheetStyle {
    /// Tiles to a row; `None` takes the number that brings the sheet nearest to 3:2.
    pub columns: Option<usize>,
    /// Space around the sheet and between tiles.
    pub margin: usize,
    /// Whole-number size of the letters of labels; the title is twice as large.
    pub text_scale: usize,
    /// Colour behind everything.
    pub background: [f32; 4],
    /// Colour of the letters.
    pub ink: [f32; 4],
    /// A line above the tiles.
    pub title: Option<String>,
}

impl Default for SheetStyle {
    /// White paper, dark grey letters of double size, 24 pixels between tiles.
    fn default() -> Self {
        Self {
            columns: None,
            margin: 24,
            text_scale: 2,
            background: [1.0; 4],
            ink: [0.03, 0.03, 0.03, 1.0],
            title: None,
        }
    }
}

/// Lays tiles out on a grid in reading order. Every cell is as large as the largest image;
/// images stand in the middle of their cells, labels centred under them.
///
/// # Errors
/// [`Error::Argument`] without tiles, for 0 columns or a text scale of 0;
/// [`Error::Limit`] above 2²⁸ pixels (4 GiB as held in memory).
pub fn contact_sheet(tiles: &[Tile<'_>], style: &SheetStyle) -> Result<Image> {
    if tiles.is_empty() || style.columns == Some(0) || style.text_scale == 0 {
        return Err(Error::argument(
            "contact sheet",
            format!("{} tiles, {:?} columns, text scale {}", tiles.len(), style.columns, style.text_scale),
            "at least one tile, one column and a text scale of 1",
            "give at least one image",
        ));
    }
    let scale = style.text_scale;
    let cell_width = tiles.iter().map(|t| t.image.width()).max().unwrap_or(1);
    let cell_height = tiles.iter().map(|t| t.image.height()).max().unwrap_or(1);
    let labels: Vec<String> = tiles.iter().map(|t| wrapped(t.label, cell_width, scale)).collect();
    let label_height = labels.iter().map(|l| font::height(l, scale)).max().unwrap_or(0);
    let gap = if label_height > 0 { 4 * scale } else { 0 };
    let (step_x, step_y) = (cell_width + style.margin, cell_height + gap + label_height + style.margin);

    let columns = style.columns.unwrap_or_else(|| columns_for(tiles.len(), step_x, step_y)).min(tiles.len());
    let width = style.margin + columns * step_x;
    let title_scale = 2 * scale;
    let title = style.title.as_deref().map(|t| wrapped(t, width.saturating_sub(2 * style.margin), title_scale));
    let title_height = title.as_deref().map_or(0, |t| font::height(t, title_scale) + style.margin);
    let height = style.margin + title_height + tiles.len().div_ceil(columns) * step_y;
    const MOST_PIXELS: usize = 1 << 28;
    if width.checked_mul(height).is_none_or(|n| n > MOST_PIXELS) {
        return Err(Error::Limit {
            what: "the contact sheet".into(),
            needed: format!("{width}×{height} pixels"),
            limit: format!("{MOST_PIXELS} pixels"),
            remedy: "use smaller or fewer images".into(),
        });
    }

    let mut sheet = Image::filled(width, height, style.background)?;
    if let Some(title) = &title {
        font::draw(&mut sheet, style.margin, style.margin, title, title_scale, style.ink);
    }
    for (index, (tile, label)) in tiles.iter().zip(&labels).enumerate() {
        let left = style.margin + index % columns * step_x;
        let top = style.margin + title_height + index / columns * step_y;
        let (inset_x, inset_y) = ((cell_width - tile.image.width()) / 2, (cell_height - tile.image.height()) / 2);
        sheet.paste(tile.image, left + inset_x, top + inset_y);
        for (row, line) in label.lines().enumerate() {
            let indent = (cell_width.saturating_sub(font::width(line, scale))) / 2;
            let y = top + cell_height + gap + row * font::LINE * scale;
            font::draw(&mut sheet, left + indent, y, line, scale, style.ink);
        }
    }
    Ok(sheet)
}

/// The number of columns whose sheet is nearest to 3:2 (in ratio), empty places counted against
/// it; the smaller of equals.
fn columns_for(count: usize, step_x: usize, step_y: usize) -> usize {
    let unlike = |columns: usize| {
        let rows = count.div_ceil(columns);
        let ratio = (columns * step_x) as f64 / (rows * step_y) as f64 / 1.5;
        ratio.max(1.0 / ratio) * (rows * columns) as f64 / count as f64
    };
    (1..=count).min_by(|&a, &b| unlike(a).total_cmp(&unlike(b))).unwrap_or(1)
}

/// Breaks lines at spaces so that they fit; a word that does not fit alone ends in "…".
fn wrapped(text: &str, width: usize, scale: usize) -> String {
    let most = ((width / scale + 1) / font::ADVANCE).max(1);
    let mut lines: Vec<String> = Vec::new();
    for line in text.lines() {
        let mut current = String::new();
        for word in line.split_whitespace() {
            let word: String = if word.chars().count() > most {
                word.chars().take(most - 1).chain(['…']).collect()
            } else {
                word.into()
            };
            let fits = current.chars().count() + 1 + word.chars().count() <= most;
            if current.is_empty() {
                current = word;
            } else if fits {
                current = format!("{current} {word}");
            } else {
                lines.push(std::mem::replace(&mut current, word));
            }
        }
        lines.push(current);
    }
    lines.join("\n")
}

#[cfg(test)]
mod tests;
