"""The shaders of the renderer `gl`: depth, colours as in `deux.simulator.shading`, and indices of faces."""

_VERTEX = """
uniform mat4 clip_from_world;
in vec3 position;
invariant gl_Position;
#ifdef COLORS
in vec2 uv;
in vec4 tint;       // base colour
in ivec2 texture_;  // number, and width | height << 16
out vec2 uv_;
flat out vec3 tint_;
flat out ivec2 texture_record;
#ifdef VERTEX_COLORS
in vec4 vertex_color;
out vec3 vertex_color_;
#endif
#endif
#ifdef FACES
in int first_face;
flat out int first_face_;
#endif

void main() {
    gl_Position = clip_from_world * vec4(position, 1.0);
#ifdef COLORS
    uv_ = uv;
    tint_ = tint.rgb;
    texture_record = texture_;
#ifdef VERTEX_COLORS
    vertex_color_ = vertex_color.rgb;
#endif
#endif
#ifdef FACES
    first_face_ = first_face;
#endif
}
"""

_FRAGMENT = """
layout(location = 0) out float depth;  // along the optical axis, in metres
#ifdef FACES
flat in int first_face_;
layout(location = FACES) out int face;
#endif
#ifdef COLORS
uniform sampler2DArray texels;   // all mip levels of all textures one after the other, in rows of 4096
uniform isampler2D level_start;  // the first texel of each level (column) of each texture (row)
in vec2 uv_;
flat in vec3 tint_;
flat in ivec2 texture_record;
layout(location = COLORS) out vec4 color;
#ifdef VERTEX_COLORS
in vec3 vertex_color_;
#endif

vec3 texel(int i) {
    return texelFetch(texels, ivec3(i & 4095, (i >> 12) & 4095, i >> 24), 0).rgb;
}

// One level of the current texture, bilinear and repeated; row 0 is at v = 1.
vec3 bilinear(vec2 at, ivec2 texture_size, int level) {
    ivec2 size = max(ivec2(1), texture_size >> level);
    int start = texelFetch(level_start, ivec2(level, texture_record.x), 0).r;
    vec2 place = fract(at) * size - 0.5;
    vec2 whole = floor(place);
    vec2 part = place - whole;
    ivec2 low = ivec2(whole);
    ivec2 high = low + 1;
    low += size & (low >> 31);
    high &= ~((size - 1 - high) >> 31);
    int above = start + low.y * size.x;
    int below = start + high.y * size.x;
    return mix(mix(texel(above + low.x), texel(above + high.x), part.x),
               mix(texel(below + low.x), texel(below + high.x), part.x), part.y);
}

vec3 trilinear() {
    ivec2 size = ivec2(texture_record.y & 0xffff, (texture_record.y >> 16) & 0xffff);
    vec2 along_x = dFdx(uv_) * size;
    vec2 along_y = dFdy(uv_) * size;
    float footprint = max(1e-12, max(dot(along_x, along_x), dot(along_y, along_y)));
    float level = clamp(0.5 * log2(footprint), 0.0, float(findMSB(max(size.x, size.y))));
    int fine = int(level);
    vec2 at = vec2(uv_.x, 1.0 - uv_.y);
    return mix(bilinear(at, size, fine), bilinear(at, size, fine + 1), level - fine);
}
#endif

void main() {
    depth = 1.0 / gl_FragCoord.w;
#ifdef FACES
    face = first_face_ + gl_PrimitiveID;
#endif
#ifdef COLORS
    color = vec4(trilinear() * tint_, 1.0);
#ifdef VERTEX_COLORS
    color.rgb *= vertex_color_;
#endif
#endif
}
"""


def shaders(colors: bool, faces: bool, vertex_colors: bool) -> tuple[str, str]:
    """The source code of the vertex shader and the fragment shader.

    Args:
        colors: whether the second attachment is colours, RGBA in [0, 1].
        faces: whether the last attachment is faces, by their position in the order of drawing.
        vertex_colors: whether vertices have colours.
    """
    defines = ["#version 430"]
    if colors:
        defines.append("#define COLORS 1")
        if vertex_colors:
            defines.append("#define VERTEX_COLORS")
    if faces:
        defines.append(f"#define FACES {1 + colors}")
    head = "\n".join(defines)
    return head + _VERTEX, head + _FRAGMENT
