//! Contact sheets.

use crate::Image;

/// Places images of one channel count in rows of `columns`, in cells of the largest width and height with `gap` pixels
/// between them; what is not covered is 0.
///
/// # Panics
/// If `columns` is 0 or the channel counts differ.
pub fn contact_sheet(images: &[&Image], columns: usize, gap: usize) -> Image {
    assert!(columns > 0, "at least one column");
    let Some(first) = images.first() else { return Image::default() };
    assert!(images.iter().all(|i| i.channels == first.channels), "one channel count");
    let cell_width = images.iter().map(|i| i.width).max().unwrap_or(0) + gap;
    let cell_height = images.iter().map(|i| i.height).max().unwrap_or(0) + gap;
    let (columns, rows) = (columns.min(images.len()), images.len().div_ceil(columns));
    let mut sheet = Image::new(columns * cell_width - gap, rows * cell_height - gap, first.channels);
    for (n, image) in images.iter().enumerate() {
        let (x, y) = (n % columns * cell_width, n / columns * cell_height);
        let row_len = image.width * image.channels;
        for (v, row) in image.data.chunks_exact(row_len.max(1)).enumerate() {
            let at = ((y + v) * sheet.width + x) * sheet.channels;
            sheet.data[at..at + row_len].copy_from_slice(row);
        }
    }
    sheet
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_images_in_rows() {
        let (a, b, c) =
            (Image::new(2, 2, 1).map(|_| 1.0), Image::new(1, 1, 1).map(|_| 2.0), Image::new(2, 1, 1));
        let sheet = contact_sheet(&[&a, &b, &c.map(|_| 3.0)], 2, 1);
        assert_eq!((sheet.width, sheet.height), (5, 5));
        let rows: Vec<&[f32]> = sheet.data.chunks(5).collect();
        assert_eq!(rows[0], [1., 1., 0., 2., 0.]);
        assert_eq!(rows[1], [1., 1., 0., 0., 0.]);
        assert_eq!(rows[3], [3., 3., 0., 0., 0.]);
        assert_eq!(contact_sheet(&[], 3, 2), Image::default());
    }
}
