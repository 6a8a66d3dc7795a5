// The cone of a Gaussian seen from the camera, and its VJP.

// Intermediate values shared by forward and backward. Lengths are in units of the distance.
struct Conic {
    // Unit direction of the centre, camera frame.
    n: vec3<f32>,
    // e_1, e_2.
    frame: array<vec3<f32>, 2>,
    // W M / d as columns, camera frame.
    axes: mat3x3<f32>,
    // V_1, V_2, V_n.
    v_1: vec3<f32>,
    v_2: vec3<f32>,
    v_n: vec3<f32>,
    // F_11, F_21, F_22.
    rows: vec3<f32>,
    // S^-1 as [[a, b], [b, c]].
    inverse: vec3<f32>,
    // Largest eigenvalue of S, at most doubled.
    spread: f32,
    // h, zero for a flat cone.
    slope: vec2<f32>,
    // sigma_k^2 / d^2 + s^2
    variances: vec3<f32>,
    // eps, zero for a flat cone.
    depth_variance: f32,
}

fn conic(placed: Placed, scale: vec3<f32>) -> Conic {
    let low_pass = view.angular_low_pass;
    let n = placed.point / placed.distance;
    let frame = tangent_frame(n);
    let axes = mat3x3(
        to_camera(placed.axes[0]),
        to_camera(placed.axes[1]),
        to_camera(placed.axes[2]),
    ) * (1.0 / placed.distance);
    let v_1 = frame[0] * axes;
    let v_2 = frame[1] * axes;
    let v_n = n * axes;
    let squares = vec2(dot(v_1, v_1), dot(v_2, v_2));
    let a = squares.x + low_pass;
    let b = dot(v_1, v_2);
    let c = squares.y + low_pass;
    let normal = cross(v_1, v_2);
    let determinant = dot(normal, normal) + low_pass * (squares.x + squares.y)
        + low_pass * low_pass;
    // S = L L^T with L = [[l11, 0], [l21, l22]]; F = L^-1.
    let f22 = sqrt(a / determinant);
    let inverse = vec3(c, -b, a) / determinant;
    let relative = scale / placed.distance;
    let variances = relative * relative + low_pass;
    var slope = vec2<f32>();
    var depth_variance = 0.0;
    if view.footprint == FOOTPRINT_RAY {
        let g = vec2(dot(v_1, v_n), dot(v_2, v_n));
        slope = vec2(dot(inverse.xy, g), dot(inverse.yz, g));
        depth_variance = variances.x * variances.y * variances.z / determinant;
    }
    return Conic(
        n,
        frame,
        axes,
        v_1,
        v_2,
        v_n,
        vec3(1.0 / sqrt(a), -b / a * f22, f22),
        inverse,
        a + c,
        slope,
        variances,
        depth_variance,
    );
}

fn across_1(cone: Conic) -> vec3<f32> {
    return cone.rows.x * cone.frame[0];
}

fn across_2(cone: Conic) -> vec3<f32> {
    return cone.rows.y * cone.frame[0] + cone.rows.z * cone.frame[1];
}

fn along(cone: Conic) -> vec3<f32> {
    return cone.n - cone.slope.x * cone.frame[0] - cone.slope.y * cone.frame[1];
}

// Rectangle around q <= q_max.
//
// With y = F a on the tangent plane the footprint is |y| <= sqrt(q') (1 - y.L^T h). It follows that
// |y| <= sqrt(q') / (1 - sqrt(q') |L^T h|); the angle's tangent is at most |y| sqrt(spread).
fn cone_bounds(cone: Conic, q_max: f32) -> PixelBox {
    let ratio = largest_ratio(cone.depth_variance, q_max);
    if ratio < 0.0 {
        return everything();
    }
    let root = sqrt(ratio);
    // |L^T h|^2 = h^T S h = g^T S^-1 g = h.g.
    let g = vec2(dot(cone.v_1, cone.v_n), dot(cone.v_2, cone.v_n));
    let rest = 1.0 - root * sqrt(max(dot(cone.slope, g), 0.0));
    if rest <= 0.0 {
        return everything();
    }
    return cap_box(cone.n, root / rest * sqrt(cone.spread));
}

// VJP of the cone, from the gradients by f_1, f_2, m and eps.
//
// The frame follows n without turning about it: de_i = -(e_i . dn) n.
fn cone_vjp(
    placed: Placed,
    cone: Conic,
    scale: vec3<f32>,
    by_across_1: vec3<f32>,
    by_across_2: vec3<f32>,
    by_along: vec3<f32>,
    by_depth_variance: f32,
) -> ShapeGradient {
    let e_1 = cone.frame[0];
    let e_2 = cone.frame[1];
    let is_exact = view.footprint == FOOTPRINT_RAY;
    let by_depth = select(0.0, by_depth_variance, is_exact);
    let by_row_1 = vec2(dot(by_across_1, e_1), dot(by_across_1, e_2));
    let by_row_2 = vec2(dot(by_across_2, e_1), dot(by_across_2, e_2));
    let by_along_frame = vec2(dot(by_along, e_1), dot(by_along, e_2));
    // By e_i . dn, with F and h fixed: the footprint moves rigidly.
    let towards_1 = dot(by_across_1, cone.n);
    let towards_2 = dot(by_across_2, cone.n);
    var turn = by_along_frame + cone.slope * dot(by_along, cone.n)
        - vec2(cone.rows.x * towards_1 + cone.rows.y * towards_2, cone.rows.z * towards_2);
    let moved = turn.x * e_1 + turn.y * e_2;
    let steps = pixel_step(cone.n);
    let centre = vec2(dot(steps[0], moved), dot(steps[1], moved));

    // S^-1 = F^T F: dL/dS = -1/2 F^T (dL/dF) S^-1, symmetrized.
    let product_1 = cone.rows.x * by_row_1 + cone.rows.y * by_row_2;
    let product_2 = cone.rows.z * by_row_2;
    let inverse = mat2x2(cone.inverse.xy, cone.inverse.yz);
    let d_1 = inverse * product_1;
    let d_2 = inverse * product_2;
    var by_s = vec3(-0.5 * d_1.x, -0.25 * (d_1.y + d_2.x), -0.5 * d_2.y);
    // h = S^-1 g.
    var by_g = vec2<f32>();
    if is_exact {
        let h = cone.slope;
        by_g = inverse * -by_along_frame;
        by_s -= vec3(by_g.x * h.x, 0.5 * (by_g.x * h.y + by_g.y * h.x), by_g.y * h.y);
        // eps = prod_k(...) / det S.
        by_s -= by_depth * cone.depth_variance * cone.inverse;
    }
    // S = V V^T + s^2 I, g = V V_n.
    let by_v_1 = 2.0 * (by_s.x * cone.v_1 + by_s.y * cone.v_2) + by_g.x * cone.v_n;
    let by_v_2 = 2.0 * (by_s.y * cone.v_1 + by_s.z * cone.v_2) + by_g.y * cone.v_n;
    let by_v_n = by_g.x * cone.v_1 + by_g.y * cone.v_2;
    turn += vec2(
        dot(by_v_n, cone.v_1) - dot(by_v_1, cone.v_n),
        dot(by_v_n, cone.v_2) - dot(by_v_2, cone.v_n),
    );
    var by_axes: mat3x3<f32>;
    var by_log_distance = 0.0;
    var by_scale = vec3<f32>();
    for (var k = 0u; k < 3u; k++) {
        by_axes[k] = by_v_1[k] * e_1 + by_v_2[k] * e_2 + by_v_n[k] * cone.n;
        by_log_distance -= dot(by_axes[k], cone.axes[k]);
        // d eps / d ln(sigma_k / d), twice eps sigma_k^2 / d^2 over the variance.
        let relative = scale[k] / placed.distance;
        let by_relative = 2.0 * by_depth * cone.depth_variance * relative / cone.variances[k];
        by_log_distance -= by_relative * relative;
        by_scale[k] = by_relative / placed.distance;
    }
    let inverse_distance = 1.0 / placed.distance;
    return ShapeGradient(
        (turn.x * e_1 + turn.y * e_2 + by_log_distance * cone.n) * inverse_distance,
        mat3x3(
            to_world(by_axes[0]) * inverse_distance,
            to_world(by_axes[1]) * inverse_distance,
            to_world(by_axes[2]) * inverse_distance,
        ),
        by_scale,
        centre,
    );
}
