// Number of an invocation in a grid of groups of `size` lanes. Groups fill rows of `groups.x`, because a dispatch takes at
// most 65,535 of them in a dimension.
fn index(group: vec3<u32>, groups: vec3<u32>, lane: u32, size: u32) -> u32 {
    return (group.y * groups.x + group.x) * size + lane;
}
