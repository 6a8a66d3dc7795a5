//! Dynamic urban scenes from UAV video.

use super::Finding;
use crate::published::Paper;

pub(super) const ID: &str = "uav-urban";

pub(super) fn check(paper: &Paper) -> Option<Vec<Finding>> {
    let table = paper.table(1)?;
    let (night, viaduct) = (
        table.number("Night crossroad", 2)?,
        table.number("Viaduct region", 2)?,
    );
    let spread = viaduct - night;
    Some(vec![
        Finding::new(
            ID,
            "Table 1",
            spread < 0.1,
            format!(
                "SSIM goes from {night:.2} (night crossroad) to {viaduct:.2} (viaduct region), \
                 LPIPS from {:.2} to {:.2}. No number of the original 4DGF is given to compare with.",
                table.number("Night crossroad", 3)?,
                table.number("Viaduct region", 3)?
            ),
        )
        .quoting("our pipeline performs consistently well across the three datasets"),
        Finding::new(
            ID,
            "Table 1",
            false,
            "The scores are of the viewpoints of the training video, so they measure \
             reconstruction of input views; novel views are shown and not scored."
                .to_owned(),
        )
        .quoting("we render the same viewpoints as those in the original UAV videos"),
    ])
}
