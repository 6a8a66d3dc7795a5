// Exclusive prefix sums, in place. Sums saturate at 2^32 - 1, so that an overflow can be detected.
//
// A workgroup scans its block of values. The blocks' totals are scanned the same way, by the same kernels
// level by level, and then added to the blocks.

const VALUES_PER_THREAD: u32 = 4u;
const BLOCK: u32 = WORKGROUP * VALUES_PER_THREAD;

struct ScanLevel {
    len: u32,
}

@group(0) @binding(0) var<uniform> level: ScanLevel;
@group(0) @binding(1) var<storage, read_write> values: array<u32>;
@group(0) @binding(2) var<storage, read_write> totals: array<u32>;

var<workgroup> sums: array<u32, WORKGROUP>;

fn saturating_add(a: u32, b: u32) -> u32 {
    let sum = a + b;
    return select(sum, 0xffffffffu, sum < a);
}

@compute @workgroup_size(256)
fn scan_blocks(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let block = workgroup_number(group, groups);
    let first = block * BLOCK + thread * VALUES_PER_THREAD;
    var sum = 0u;
    for (var i = 0u; i < VALUES_PER_THREAD; i++) {
        if first + i < level.len {
            sum = saturating_add(sum, values[first + i]);
        }
    }
    sums[thread] = sum;
    workgroupBarrier();
    for (var distance = 1u; distance < WORKGROUP; distance *= 2u) {
        var left = 0u;
        if thread >= distance {
            left = sums[thread - distance];
        }
        workgroupBarrier();
        sums[thread] = saturating_add(sums[thread], left);
        workgroupBarrier();
    }
    var before = 0u;
    if thread > 0u {
        before = sums[thread - 1u];
    }
    for (var i = 0u; i < VALUES_PER_THREAD; i++) {
        if first + i < level.len {
            let value = values[first + i];
            values[first + i] = before;
            before = saturating_add(before, value);
        }
    }
    if thread == WORKGROUP - 1u && block * BLOCK < level.len {
        totals[block] = sums[thread];
    }
}

@compute @workgroup_size(256)
fn add_totals(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index < level.len {
        values[index] = saturating_add(values[index], totals[index / BLOCK]);
    }
}
