//! Labels and lines of axes: a macro, because plotters has a type of its own for every pair of axes.

/// Draws the mesh of a chart with at most so many labels, as their formatters write them.
macro_rules! mesh {
    ($chart:ident, $titles:ident, $y_labels:expr, $x_label:expr, $y_label:expr) => {
        $chart
            .configure_mesh()
            .x_desc($titles.x)
            .y_desc($titles.y)
            .x_labels(8)
            .y_labels($y_labels)
            .x_label_formatter(&$x_label)
            .y_label_formatter(&$y_label)
            .label_style(("sans-serif", 13))
            .axis_desc_style(("sans-serif", 14))
            .light_line_style(TRANSPARENT)
            .draw()?;
    };
}
