// Trilinear lookups of OpenImageIO's texture system, looped over arrays inside C++, so that no binding is in the measured time.
#include <OpenImageIO/imageio.h>
#include <OpenImageIO/texture.h>

#include <cmath>
#include <string>
#include <vector>

using namespace OIIO;

namespace {
struct Texture {
    decltype(TextureSystem::create(false)) system;
    TextureSystem::TextureHandle* handle;
    TextureSystem::Perthread* thread;
    TextureOpt options;
    float scale;
};
}  // namespace

extern "C" {

const char* shim_version() { return OIIO_VERSION_STRING; }

// Writes side x side floats and all levels above them, each the average of 2 x 2, as a tiled TIFF without compression.
bool shim_write(const char* path, const float* base, int side)
{
    auto out = ImageOutput::create(path);
    if (!out)
        return false;
    // As maketx does it: TIFF has levels as further images.
    auto more = out->supports("mipmap") ? ImageOutput::AppendMIPLevel : ImageOutput::AppendSubimage;
    std::vector<float> level(base, base + size_t(side) * side);
    for (bool first = true;; first = false) {
        ImageSpec spec(side, side, 1, TypeDesc::FLOAT);
        spec.tile_width = spec.tile_height = 64;
        spec.attribute("compression", "none");
        spec.attribute("textureformat", "Plain Texture");
        if (!out->open(path, spec, first ? ImageOutput::Create : more))
            return false;
        if (!out->write_image(TypeDesc::FLOAT, level.data()))
            return false;
        if (side == 1)
            return out->close();
        int half = side / 2;
        for (int y = 0; y < half; ++y)
            for (int x = 0; x < half; ++x) {
                const float* p = &level[size_t(2 * y) * side + 2 * x];
                float sum      = (p[0] + p[1]) + (p[side] + p[side + 1]);
                level[size_t(y) * half + x] = 0.25f * sum;
            }
        level.resize(size_t(half) * half);
        side = half;
    }
}

// Opens a texture of side x side texels with a cache that holds all of it; width is that of the footprint in texels.
void* shim_open(const char* path, int side, float width)
{
    auto* t   = new Texture { TextureSystem::create(false), nullptr, nullptr, TextureOpt(), 1.0f / side };
    t->system->attribute("max_memory_MB", 4096.0f);
    t->thread = t->system->get_perthread_info();
    t->handle = t->system->get_texture_handle(ustring(path), t->thread);
    if (!t->handle || !t->system->good(t->handle)) {
        delete t;
        return nullptr;
    }
    t->options.swrap = t->options.twrap = TextureOpt::WrapClamp;
    t->options.mipmode    = TextureOpt::MipModeTrilinear;
    t->options.interpmode = TextureOpt::InterpBilinear;
    t->options.swidth = t->options.twidth = width;
    return t;
}

// Looks all points up, in texels, and returns the sum of the answers; writes them too if there is room.
float shim_sum(void* texture, size_t n, const float* x, const float* y, float* answers)
{
    auto* t     = static_cast<Texture*>(texture);
    float scale = t->scale, sum = 0.0f;
    for (size_t i = 0; i < n; ++i) {
        float value = 0.0f;
        if (!t->system->texture(t->handle, t->thread, t->options, x[i] * scale, y[i] * scale,
                                scale, 0.0f, 0.0f, scale, 1, &value))
            return NAN;
        if (answers)
            answers[i] = value;
        sum += value;
    }
    return sum;
}
}
