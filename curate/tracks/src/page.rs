//! `tracks.html`: the paths from above, and the boxes over some frames.

use std::{fmt::Write as _, path::Path};

use base64::{Engine, engine::general_purpose::STANDARD};
use glam::{DVec2, DVec3, dvec2};
use image::codecs::jpeg::JpegEncoder;
use omnilife_schemas::{
    RgbImage,
    plain_text::for_html,
    posed_view::PosedView,
    records::{Scene, Tracks},
    store,
    trajectory::GroundAxes,
};

use super::boxes::projected_box;
use crate::error::TracksError;

/// Number of shown frames, evenly spaced.
const FRAMES: usize = 8;
/// Their maximum width, pixels.
const WIDTH: usize = 640;
/// Side of the plan, pixels.
const PLAN: f64 = 640.0;

/// Begin of the page. Paths keep a light ground in dark windows too: their colours are made for it.
const HEAD: &str = r#"<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<link rel="icon" href="data:,">
<title>@TITLE@</title>
<style>
:root { color-scheme: light dark; --paper: light-dark(#fff, #14171a); --ink: light-dark(#16191d, #eceff2); --rule: light-dark(#d3d7dd, #3a4149); }
* { box-sizing: border-box; }
body { margin: 0; background: var(--paper); color: var(--ink); font: 1rem/1.5 system-ui, sans-serif; }
main { max-width: 90rem; margin: 0 auto; padding: 0.5rem 1.25rem 2rem; }
h1 { font-size: 1.6rem; line-height: 1.2; margin: 1rem 0 0.5rem; overflow-wrap: anywhere; }
h2 { font-size: 1.2rem; margin: 1.5rem 0 0.5rem; }
.pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 30rem), 1fr)); gap: 1rem 2rem; align-items: start; }
.frames { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 26rem), 1fr)); gap: 1rem; }
figure { margin: 0; min-width: 0; }
svg { display: block; width: 100%; max-width: 640px; height: auto; background: #eee; border-radius: 4px; }
.scroll { position: relative; overflow-x: auto; }
:focus-visible { outline: 3px solid light-dark(#0b57b0, #7db7ff); outline-offset: 2px; }
table { border-collapse: collapse; font-size: 0.925rem; }
th, td { padding: 0.25rem 0.75rem 0.25rem 0; text-align: left; vertical-align: top; border-bottom: 1px solid var(--rule); }
td:last-child { white-space: nowrap; }
@media (max-width: 40rem) {
  main { padding-inline: 0.9rem; }
  table, tbody { display: block; }
  tr { display: grid; grid-template-columns: 6rem 1fr auto; border-bottom: 1px solid var(--rule); }
  th, td { border: 0; }
  tr > :nth-child(3) { grid-area: 2 / 1 / 2 / -1; }
  svg text { font-size: 26px; }
}
</style>
</head>
<body>
<main>
<h1>@TITLE@</h1>
"#;

/// Writes the page atomically.
///
/// # Errors
/// When a frame cannot be read or the page cannot be written.
pub(super) fn write(
    path: &Path,
    folder: &Path,
    scene: &Scene,
    views: &[PosedView],
    tracks: &Tracks,
) -> Result<(), TracksError> {
    let mut page = HEAD.replace("@TITLE@", &format!("Tracks of {}", for_html(&scene.id)));
    page += "<h2>From above</h2>\n<div class=\"pair\">\n";
    page += &plan(tracks, views);
    page += "<div class=\"scroll\" role=\"region\" tabindex=\"0\" aria-label=\"Stages\"><table>\n\
             <tr><th scope=\"col\">stage</th><th scope=\"col\">method</th>\
             <th scope=\"col\">evidence</th><th scope=\"col\">time</th></tr>\n";
    for stage in &tracks.stages {
        let (name, method, reason) = (&stage.stage, &stage.method, for_html(&stage.reason));
        let _ = writeln!(
            page,
            "<tr><td>{name}</td><td>{method}</td><td>{reason}</td><td>{:.2} s</td></tr>",
            stage.took.wall_seconds
        );
    }
    page += "</table></div>\n</div>\n";
    if !tracks.warnings.is_empty() {
        page += "<ul>\n";
        for warning in &tracks.warnings {
            let _ = writeln!(page, "<li>{}</li>", for_html(warning));
        }
        page += "</ul>\n";
    }
    page += "<h2>Boxes: dashed as detected, solid as tracked</h2>\n<div class=\"frames\">\n";
    let step = views.len().div_ceil(FRAMES).max(1);
    for view in views.iter().step_by(step) {
        page += &frame(folder, scene, view, tracks)?;
    }
    page += "</div>\n</main>\n</body>\n</html>\n";
    Ok(store::write_bytes(path, page.as_bytes())?)
}

/// Returns the hue of an id's colour: neighbouring ids differ clearly.
pub(super) fn hue_degrees(id: u32) -> f64 {
    (f64::from(id) * 137.508) % 360.0
}

fn colour(id: u32) -> String {
    format!("hsl({}, 85%, 42%)", hue_degrees(id))
}

fn plan(tracks: &Tracks, views: &[PosedView]) -> String {
    let axes = GroundAxes::new(DVec3::from_array(tracks.up));
    let on_plan = |point: DVec3| -> DVec2 {
        let own = axes.to_world.transpose() * point;
        dvec2(own.x, -own.y)
    };
    let paths: Vec<(u32, Vec<DVec2>)> = tracks
        .tracks
        .iter()
        .map(|track| {
            let [begin, end] = track.path.centre.range();
            let place = |step: i32| {
                track
                    .path
                    .centre
                    .position(begin + (end - begin) * f64::from(step) / 60.0)
            };
            (
                track.id,
                (0..=60).map(|step| on_plan(place(step))).collect(),
            )
        })
        .collect();
    let cameras: Vec<DVec2> = views.iter().map(|view| on_plan(view.centre)).collect();
    let all = || paths.iter().flat_map(|(_, path)| path).chain(&cameras);
    let low = all().fold(DVec2::INFINITY, |low, &point| low.min(point));
    let high = all().fold(DVec2::NEG_INFINITY, |high, &point| high.max(point));
    let size = (high - low).max_element();
    let scale = if size > 0.0 && size.is_finite() {
        (PLAN - 40.0) / size
    } else {
        1.0
    };
    let place = |point: DVec2| (point - low) * scale + 20.0;
    let line = |points: &[DVec2]| -> String {
        points
            .iter()
            .map(|&point| format!("{:.1},{:.1} ", place(point).x, place(point).y))
            .collect()
    };
    let mut svg = format!(
        "<svg viewBox=\"0 0 {PLAN} {PLAN}\" role=\"img\" \
         aria-label=\"Paths of {} tracks and of the camera, dashed, from above\">\n",
        paths.len()
    );
    let _ = writeln!(
        svg,
        "<polyline points=\"{}\" fill=\"none\" stroke=\"#666\" stroke-dasharray=\"4\"/>",
        line(&cameras)
    );
    for (id, path) in &paths {
        let colour = colour(*id);
        let _ = writeln!(
            svg,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\"/>",
            line(path)
        );
        if let Some(&end) = path.last() {
            let at = place(end);
            let _ = writeln!(
                svg,
                "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"4\" fill=\"{colour}\"/><text x=\"{:.1}\" y=\"{:.1}\">{id}</text>",
                at.x,
                at.y,
                at.x + 6.0,
                at.y - 6.0
            );
        }
    }
    svg + &scale_bar(scale / tracks.metres_per_unit) + "</svg>\n"
}

/// Returns a bar of a round length at the lower left of a plan with this number of pixels per metre.
fn scale_bar(pixels_per_metre: f64) -> String {
    let longest = PLAN / 4.0 / pixels_per_metre;
    let decade = 10_f64.powf(longest.log10().floor());
    let factor = [5.0, 2.0]
        .into_iter()
        .find(|factor| decade * factor <= longest);
    let metres = decade * factor.unwrap_or(1.0);
    let (bottom, right) = (PLAN - 8.0, 20.0 + metres * pixels_per_metre);
    format!(
        "<path d=\"M20 {0} V{bottom} H{right:.1} V{0}\" fill=\"none\" stroke=\"#111\"/>\
         <text x=\"{1:.1}\" y=\"{bottom}\">{metres} m</text>\n",
        bottom - 6.0,
        right + 6.0
    )
}

fn frame(
    folder: &Path,
    scene: &Scene,
    view: &PosedView,
    tracks: &Tracks,
) -> Result<String, TracksError> {
    let file = folder.join(&scene.frames[view.frame as usize].image);
    let image = RgbImage::read(&file)?;
    let (full_width, full_height) = (image.width, image.height);
    let width = full_width.min(WIDTH);
    let height = (full_height * width / full_width).max(1);
    let bytes = image.resized_by_area(width, height).to_rgb8();
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, 85)
        .encode(
            &bytes,
            width as u32,
            height as u32,
            image::ExtendedColorType::Rgb8,
        )
        .map_err(|error| TracksError::internal(&file, error))?;
    let mut html = format!(
        "<figure><figcaption>{:.2} s</figcaption>\
         <svg viewBox=\"0 0 {full_width} {full_height}\" style=\"max-width: {width}px\" role=\"img\" aria-label=\"Frame {} with boxes\">\n\
         <image href=\"data:image/jpeg;base64,{}\" width=\"{full_width}\" height=\"{full_height}\"/>\n",
        view.seconds,
        view.frame,
        STANDARD.encode(&jpeg)
    );
    let mut rectangle = |[left, top, width, height]: [f64; 4], colour: &str, more: &str| {
        let _ = writeln!(
            html,
            "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" fill=\"none\" stroke=\"{colour}\" {more}/>"
        );
    };
    for detection in tracks
        .detections
        .iter()
        .filter(|one| one.frame == view.frame)
    {
        let colour = detection.track.map_or("#fff".to_owned(), colour);
        rectangle(detection.box_pixels, &colour, "stroke-dasharray=\"3\"");
    }
    let axes = GroundAxes::new(DVec3::from_array(tracks.up));
    for track in &tracks.tracks {
        let Some((centre, heading)) = track.path.at(view.seconds) else {
            continue;
        };
        if let Some(sides) = projected_box(view, centre, axes.rotation(heading), track.dimensions) {
            rectangle(sides, &colour(track.id), "stroke-width=\"1.5\"");
        }
    }
    Ok(html + "</svg></figure>\n")
}
