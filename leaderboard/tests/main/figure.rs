//! Figures for papers.

use std::fs;

use omnilife_leaderboard::figure::{FigureRequest, figure};
use omnilife_schemas::{Classified, ErrorKind, rgb::RgbImage};

use crate::site::small_site;

#[test]
fn a_figure_shows_scenes_by_methods_and_names_both() {
    let folder = tempfile::tempdir().unwrap();
    let results = small_site(folder.path()).results;
    let request = FigureRequest {
        results,
        out: folder.path().join("paper/figure"),
        protocol: Some("per-scene".to_owned()),
        scenes: Vec::new(),
        methods: ["odgs", "odgs-published"].map(str::to_owned).to_vec(),
        frame: None,
        inset: Some([0.5, 0.1, 0.25]),
        panel_width: 128,
    };
    let drawn = figure(&request).unwrap();
    // One of three scenes has images.
    assert_eq!(drawn.rows, [("street/seq-000".to_owned(), 4)]);
    assert_eq!(drawn.columns, ["Ground truth", "odgs", "odgs-published"]);
    let image = RgbImage::read(&drawn.png).unwrap();
    assert_eq!((image.width, image.height), (3 * 128 + 2 * 6, 64 + 32 + 6));
    // The methods' right halves are bluer than the truth's, by 60 of 255.
    let blue = |column: usize| image.data[(40 * image.width + column) * 3 + 2];
    assert!(blue(120) < 0.01 && (blue(2 * 134 + 120) - 60.0 / 255.0).abs() < 0.01);
    let svg = fs::read_to_string(&drawn.svg).unwrap();
    assert!(svg.contains(">odgs-published</text>") && svg.contains("street/seq-000 (4)"));
    assert!(svg.contains("data:image/png;base64,iVBOR"));

    let refused = |request: FigureRequest| {
        let error = figure(&request).unwrap_err();
        assert_eq!(error.error_kind(), ErrorKind::User);
        error.to_string()
    };
    assert_eq!(figure(&request).unwrap(), drawn, "the same figure again");
    fs::write(&drawn.svg, "mine").unwrap();
    assert!(refused(request.clone()).contains("figure.svg: is there already"));
    assert_eq!(fs::read_to_string(&drawn.svg).unwrap(), "mine");
    let out = folder.path().join("other");
    let unknown = FigureRequest {
        methods: vec!["nobody".to_owned()],
        out: out.clone(),
        ..request.clone()
    };
    assert!(refused(unknown).contains("has no method nobody; there are "));
    let without_views = FigureRequest {
        scenes: vec!["hall/seq-000".to_owned()],
        out,
        ..request
    };
    assert!(refused(without_views).contains("share no novel view of scene hall/seq-000"));
}
