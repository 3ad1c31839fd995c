#include "recon/products/rasters/layer_patch.hpp"

#include <isa-l/igzip_lib.h>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>

#include "recon/geometry/mesh.hpp"

namespace fathom::topside {
namespace {

constexpr int kMaxSamples = 4;  // along a mosaic cell's side: more would not change a mean of 8 bits

// A window whose cells are `parts` times smaller, and which of a mesh's corners stand where in it.
std::array<Eigen::Vector2d, 3> cornersIn(const CellWindow& window, double cell, int parts, const Mesh& mesh,
                                         const std::array<std::uint32_t, 3>& triangle) {
  std::array<Eigen::Vector2d, 3> p;
  for (std::size_t k = 0; k < 3; ++k) {
    const Eigen::Vector3f& v = mesh.vertices[triangle[k]];
    p[k] = {(static_cast<double>(v.x()) / cell - window.x) * parts - 0.5,
            (static_cast<double>(v.y()) / cell - window.y) * parts - 0.5};
  }
  return p;
}

float mixed(const std::array<double, 3>& w, float a, float b, float c) {
  return static_cast<float>(w[0]) * a + static_cast<float>(w[1]) * b + static_cast<float>(w[2]) * c;
}

void drawSurface(const TileMesh& tile, LayerPatch& patch) {
  const Mesh& mesh = tile.mesh;
  const std::size_t cells = patch.surface.cells();
  patch.elevation.assign(cells, kNoValue);
  patch.sigma.assign(cells, kNoValue);
  patch.views.assign(cells, 0);
  for (const auto& t : mesh.triangles) {
    const std::uint32_t a = t[0], b = t[1], c = t[2];
    const auto corners = cornersIn(patch.surface, patch.cells.surface, 1, mesh, t);
    scanTriangle(
        corners, patch.surface.rows, patch.surface.columns,
        [&](int row, int column, const std::array<double, 3>& w) {
          const std::size_t at = patch.surface.at(row, column);
          const float up = -mixed(w, mesh.vertices[a].z(), mesh.vertices[b].z(), mesh.vertices[c].z());
          if (up <= patch.elevation[at]) return;  // false where nothing is known yet
          patch.elevation[at] = up;
          if (!mesh.sigma.empty()) patch.sigma[at] = mixed(w, mesh.sigma[a], mesh.sigma[b], mesh.sigma[c]);
          if (!tile.views.empty())
            patch.views[at] =
                static_cast<std::uint16_t>(mixed(w, tile.views[a], tile.views[b], tile.views[c]) + 0.5F);
        });
  }
}

struct Colour {
  float r = 0, g = 0, b = 0;
};

// Between the four texels around a place; texture coordinates as Mesh has them.
Colour colourAt(const RgbImage& image, float s, float t) {
  const float x =
      std::clamp(s * static_cast<float>(image.width) - 0.5F, 0.0F, static_cast<float>(image.width - 1));
  const float y = std::clamp((1 - t) * static_cast<float>(image.height) - 0.5F, 0.0F,
                             static_cast<float>(image.height - 1));
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const int x1 = std::min(x0 + 1, image.width - 1), y1 = std::min(y0 + 1, image.height - 1);
  const float u = x - static_cast<float>(x0), v = y - static_cast<float>(y0);
  const std::uint8_t *a = image.at(x0, y0), *b = image.at(x1, y0), *c = image.at(x0, y1),
                     *d = image.at(x1, y1);
  const auto mix = [&](int k) {
    return (1 - v) * ((1 - u) * a[k] + u * b[k]) + v * ((1 - u) * c[k] + u * d[k]);
  };
  return {mix(0), mix(1), mix(2)};
}

void drawMosaic(const TexturedTile& leaf, LayerPatch& patch) {
  const Mesh& mesh = leaf.surface.mesh;
  const bool textured = !leaf.atlas.empty() && mesh.texture_coordinates.size() == mesh.vertices.size();
  const bool coloured = mesh.colours.size() == mesh.vertices.size();
  patch.rgba.assign(4 * patch.mosaic.cells(), 0);
  if (!textured && !coloured) return;
  int parts = 1;
  if (textured && leaf.texel > 0)
    parts = std::clamp(static_cast<int>(std::lround(patch.cells.mosaic / leaf.texel)), 1, kMaxSamples);
  CellWindow fine = patch.mosaic;
  fine.rows *= parts;
  fine.columns *= parts;
  struct Sample {
    float depth = std::numeric_limits<float>::infinity();
    Colour colour;
  };
  std::vector<Sample> samples(fine.cells());
  for (const auto& t : mesh.triangles) {
    const std::uint32_t a = t[0], b = t[1], c = t[2];
    const auto corners = cornersIn(patch.mosaic, patch.cells.mosaic, parts, mesh, t);
    scanTriangle(corners, fine.rows, fine.columns, [&](int row, int column, const std::array<double, 3>& w) {
      Sample& sample = samples[fine.at(row, column)];
      const float depth = mixed(w, mesh.vertices[a].z(), mesh.vertices[b].z(), mesh.vertices[c].z());
      if (depth >= sample.depth) return;
      sample.depth = depth;
      if (textured) {
        const auto &pa = mesh.texture_coordinates[a], &pb = mesh.texture_coordinates[b],
                   &pc = mesh.texture_coordinates[c];
        sample.colour =
            colourAt(leaf.atlas, mixed(w, pa.x(), pb.x(), pc.x()), mixed(w, pa.y(), pb.y(), pc.y()));
      } else {
        const auto channel = [&](std::size_t k) {
          return mixed(w, mesh.colours[a][k], mesh.colours[b][k], mesh.colours[c][k]);
        };
        sample.colour = {channel(0), channel(1), channel(2)};
      }
    });
  }
  for (int row = 0; row < patch.mosaic.rows; ++row) {
    for (int column = 0; column < patch.mosaic.columns; ++column) {
      Colour sum;
      float known = 0;
      for (int i = 0; i < parts; ++i) {
        for (int j = 0; j < parts; ++j) {
          const Sample& sample = samples[fine.at(row * parts + i, column * parts + j)];
          if (!std::isfinite(sample.depth)) continue;
          known += 1;
          sum.r += sample.colour.r;
          sum.g += sample.colour.g;
          sum.b += sample.colour.b;
        }
      }
      if (known == 0) continue;
      std::uint8_t* to = &patch.rgba[4 * patch.mosaic.at(row, column)];
      to[0] = static_cast<std::uint8_t>(sum.r / known + 0.5F);
      to[1] = static_cast<std::uint8_t>(sum.g / known + 0.5F);
      to[2] = static_cast<std::uint8_t>(sum.b / known + 0.5F);
      to[3] = 255;
    }
  }
}

}  // namespace

CellWindow cellsOf(const TileId& tile, const TileGrid& grid, double cell) {
  // Tiles meet on the lattice's nearest plane to their border; the middle of cell k is at k + 1/2.
  const auto box = grid.box(tile);
  const auto first = [&](double border) {
    return static_cast<std::int32_t>(std::ceil(TileGrid::snap(border) / cell - 0.5));
  };
  const CellWindow window{first(box[0]), first(box[1]), 0, 0};
  return {window.x, window.y, first(box[2]) - window.x, first(box[3]) - window.y};
}

LayerPatch makeLayerPatch(const TexturedTile& leaf, const TileGrid& grid, const LayerCells& cells) {
  if (!(cells.surface > 0) || !(cells.mosaic > 0))
    throw std::invalid_argument("cells of layers must be above zero");
  if (leaf.surface.tile.level != 0) throw std::invalid_argument("layers are drawn from leaf tiles");
  LayerPatch patch;
  patch.tile = leaf.surface.tile;
  patch.cells = cells;
  patch.surface = cellsOf(patch.tile, grid, cells.surface);
  patch.mosaic = cellsOf(patch.tile, grid, cells.mosaic);
  drawSurface(leaf.surface, patch);
  drawMosaic(leaf, patch);
  return patch;
}

namespace {

constexpr std::array<char, 8> kMagic = {'F', 'P', 'A', 'T', 'C', 'H', '0', '1'};
constexpr double kUnit = 1e-4;             // of heights and sigma [m]
constexpr std::int32_t kMaxEdge = 32'768;  // of a window [cells]: more is no patch
constexpr std::size_t kSurfaceBytes = 9;   // a cell: mask, height (4 planes), sigma (2), views (2)
constexpr std::size_t kMosaicBytes = 4;

struct Head {
  std::array<char, 8> magic = kMagic;
  std::int32_t level = 0, x = 0, y = 0, unused = 0;
  LayerCells cells;
  CellWindow surface, mosaic;
  std::uint32_t surface_bytes = 0, mosaic_bytes = 0;
};
static_assert(std::is_trivially_copyable_v<Head> && sizeof(Head) == 80);

[[noreturn]] void refusePatch() {
  throw std::runtime_error("not a tile's layer patch, or a damaged one");
}

std::vector<std::uint8_t> deflated(const std::vector<std::uint8_t>& raw) {
  std::vector<std::uint8_t> out(raw.size() + raw.size() / 8 + 1024), work(ISAL_DEF_LVL1_DEFAULT);
  isal_zstream stream{};
  isal_deflate_stateless_init(&stream);
  stream.level = 1;
  stream.level_buf = work.data();
  stream.level_buf_size = static_cast<std::uint32_t>(work.size());
  stream.end_of_stream = 1;
  stream.next_in = const_cast<std::uint8_t*>(raw.data());
  stream.avail_in = static_cast<std::uint32_t>(raw.size());
  stream.next_out = out.data();
  stream.avail_out = static_cast<std::uint32_t>(out.size());
  if (isal_deflate_stateless(&stream) != COMP_OK) throw std::runtime_error("a layer patch does not deflate");
  out.resize(stream.total_out);
  return out;
}

std::vector<std::uint8_t> inflated(std::span<const std::uint8_t> bytes, std::size_t raw_size) {
  std::vector<std::uint8_t> raw(raw_size);
  inflate_state state{};
  isal_inflate_init(&state);
  state.next_in = const_cast<std::uint8_t*>(bytes.data());
  state.avail_in = static_cast<std::uint32_t>(bytes.size());
  state.next_out = raw.data();
  state.avail_out = static_cast<std::uint32_t>(raw.size());
  if (isal_inflate_stateless(&state) != ISAL_DECOMP_OK || state.total_out != raw_size) refusePatch();
  return raw;
}

// Byte `place` of `value`, to the plane of that byte.
template <typename T>
void putPlanes(std::uint8_t* planes, std::size_t cells, std::size_t cell, T value) {
  for (std::size_t k = 0; k < sizeof value; ++k)
    planes[k * cells + cell] = static_cast<std::uint8_t>(value >> (8 * k));
}
template <typename T>
T takePlanes(const std::uint8_t* planes, std::size_t cells, std::size_t cell) {
  T value = 0;
  for (std::size_t k = 0; k < sizeof value; ++k)
    value = static_cast<T>(value | static_cast<T>(static_cast<T>(planes[k * cells + cell]) << (8 * k)));
  return value;
}

constexpr std::uint8_t kKnown = 1, kSigmaKnown = 2;

std::vector<std::uint8_t> surfaceBytes(const LayerPatch& patch) {
  const std::size_t n = patch.surface.cells();
  std::vector<std::uint8_t> raw(kSurfaceBytes * n);
  std::int32_t before = 0;
  for (std::size_t k = 0; k < n; ++k) {
    const float up = patch.elevation[k], sigma = patch.sigma[k];
    if (!(std::abs(up) < 1e5F)) continue;  // 0.1 mm in 32 bits
    const auto height = static_cast<std::int32_t>(std::lround(static_cast<double>(up) / kUnit));
    const auto step = static_cast<std::uint32_t>(height) - static_cast<std::uint32_t>(before);
    const auto folded = (step << 1) ^ (0U - (step >> 31));  // small steps of either sign in few bytes
    before = height;
    raw[k] = kKnown;
    putPlanes(&raw[n], n, k, folded);
    if (std::isfinite(sigma)) {
      raw[k] |= kSigmaKnown;
      const double most = std::numeric_limits<std::uint16_t>::max();
      putPlanes(&raw[5 * n], n, k,
                static_cast<std::uint16_t>(std::clamp(static_cast<double>(sigma) / kUnit + 0.5, 0.0, most)));
    }
    putPlanes(&raw[7 * n], n, k, patch.views[k]);
  }
  return raw;
}

void takeSurface(const std::vector<std::uint8_t>& raw, LayerPatch& patch) {
  const std::size_t n = patch.surface.cells();
  patch.elevation.assign(n, kNoValue);
  patch.sigma.assign(n, kNoValue);
  patch.views.assign(n, 0);
  std::uint32_t height = 0;
  for (std::size_t k = 0; k < n; ++k) {
    if ((raw[k] & kKnown) == 0) continue;
    const auto folded = takePlanes<std::uint32_t>(&raw[n], n, k);
    height += (folded >> 1) ^ (0U - (folded & 1));
    patch.elevation[k] = static_cast<float>(static_cast<std::int32_t>(height) * kUnit);
    if ((raw[k] & kSigmaKnown) != 0)
      patch.sigma[k] = static_cast<float>(takePlanes<std::uint16_t>(&raw[5 * n], n, k) * kUnit);
    patch.views[k] = takePlanes<std::uint16_t>(&raw[7 * n], n, k);
  }
}

// Planes of alpha, green, and red and blue less green, each less the one before it.
std::vector<std::uint8_t> mosaicBytes(const LayerPatch& patch) {
  const std::size_t n = patch.mosaic.cells();
  std::vector<std::uint8_t> raw(kMosaicBytes * n);
  std::array<std::uint8_t, 3> before{};
  for (std::size_t k = 0; k < n; ++k) {
    const std::uint8_t* rgba = &patch.rgba[4 * k];
    raw[k] = rgba[3];
    if (rgba[3] == 0) continue;
    const std::array<std::uint8_t, 3> now = {rgba[1], static_cast<std::uint8_t>(rgba[0] - rgba[1]),
                                             static_cast<std::uint8_t>(rgba[2] - rgba[1])};
    for (std::size_t c = 0; c < 3; ++c) raw[(c + 1) * n + k] = static_cast<std::uint8_t>(now[c] - before[c]);
    before = now;
  }
  return raw;
}

void takeMosaic(const std::vector<std::uint8_t>& raw, LayerPatch& patch) {
  const std::size_t n = patch.mosaic.cells();
  patch.rgba.assign(4 * n, 0);
  std::array<std::uint8_t, 3> now{};
  for (std::size_t k = 0; k < n; ++k) {
    if (raw[k] == 0) continue;
    for (std::size_t c = 0; c < 3; ++c) now[c] = static_cast<std::uint8_t>(now[c] + raw[(c + 1) * n + k]);
    std::uint8_t* rgba = &patch.rgba[4 * k];
    rgba[0] = static_cast<std::uint8_t>(now[1] + now[0]);
    rgba[1] = now[0];
    rgba[2] = static_cast<std::uint8_t>(now[2] + now[0]);
    rgba[3] = raw[k];
  }
}

bool believable(const CellWindow& window) {
  return window.rows >= 0 && window.rows <= kMaxEdge && window.columns >= 0 && window.columns <= kMaxEdge &&
         window.cells() < (std::size_t{1} << 28);
}

}  // namespace

std::vector<std::uint8_t> packLayerPatch(const LayerPatch& patch) {
  const std::vector<std::uint8_t> surface = deflated(surfaceBytes(patch)),
                                  mosaic = deflated(mosaicBytes(patch));
  Head head;
  head.level = patch.tile.level;
  head.x = patch.tile.x;
  head.y = patch.tile.y;
  head.cells = patch.cells;
  head.surface = patch.surface;
  head.mosaic = patch.mosaic;
  head.surface_bytes = static_cast<std::uint32_t>(surface.size());
  head.mosaic_bytes = static_cast<std::uint32_t>(mosaic.size());
  std::vector<std::uint8_t> bytes(sizeof head);
  std::memcpy(bytes.data(), &head, sizeof head);
  bytes.insert(bytes.end(), surface.begin(), surface.end());
  bytes.insert(bytes.end(), mosaic.begin(), mosaic.end());
  return bytes;
}

LayerPatch unpackLayerPatch(std::span<const std::uint8_t> bytes, PatchPart part) {
  Head head;
  if (bytes.size() < sizeof head) refusePatch();
  std::memcpy(&head, bytes.data(), sizeof head);
  bytes = bytes.subspan(sizeof head);
  if (head.magic != kMagic || !believable(head.surface) || !believable(head.mosaic) ||
      bytes.size() != std::size_t{head.surface_bytes} + head.mosaic_bytes)
    refusePatch();
  LayerPatch patch;
  patch.tile = {head.level, head.x, head.y};
  patch.cells = head.cells;
  patch.surface = head.surface;
  patch.mosaic = head.mosaic;
  if (part != PatchPart::kMosaic)
    takeSurface(inflated(bytes.first(head.surface_bytes), kSurfaceBytes * patch.surface.cells()), patch);
  if (part != PatchPart::kSurface)
    takeMosaic(inflated(bytes.subspan(head.surface_bytes), kMosaicBytes * patch.mosaic.cells()), patch);
  return patch;
}

}  // namespace fathom::topside
