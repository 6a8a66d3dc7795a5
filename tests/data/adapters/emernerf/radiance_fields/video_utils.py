import images


def render_pixels(files):
    return {key: [images.read(file)[2] for file in files] for key in ("gt_rgbs", "rgbs")}


def save_videos(render_results, save_pth, save_images=False):
    for key, views in render_results.items():
        place = save_pth.with_name(f"{save_pth.stem}_{key}.mp4")
        place.parent.mkdir(exist_ok=True)
        place.write_text("lossy")
        # Of three cameras.
        for number, view in enumerate(views if save_images else []):
            images.write(place.with_name(f"{place.stem}_{3 * number:03}.png"), view)
