#include "telemetry/monitor/map/surface.hpp"

#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "telemetry/monitor/map/surface_nodes.hpp"

namespace fathom::monitor {
namespace {

constexpr Rgb kNoColour{128, 128, 128};
constexpr std::uint32_t kVertexRow = kChunkUnits + 1;

double metres(Unit units) {
  return static_cast<double>(units) / kUnitsPerMetre;
}

// A cell inside its chunk, of any spacing up to the chunk itself.
std::uint32_t cellId(int code, Place p) {
  const auto n = static_cast<std::uint32_t>((p.north & (kChunkUnits - 1)) >> code);
  const auto e = static_cast<std::uint32_t>((p.east & (kChunkUnits - 1)) >> code);
  return static_cast<std::uint32_t>(code) << (2 * kChunkCode) | n << kChunkCode | e;
}

ChunkKey chunkAt(Place p) {
  return {p.north >> kChunkCode, p.east >> kChunkCode};
}

Place cornerOf(ChunkKey key) {
  return {key.north * kChunkUnits, key.east * kChunkUnits};
}

}  // namespace

class Surface::Builder {
 public:
  Builder(Surface& surface, ChunkKey key) : nodes_(surface.store_, key), origin_(cornerOf(key)) {
    for (std::int32_t n = -1; n <= 1; ++n)
      for (std::int32_t e = -1; e <= 1; ++e) {
        const ChunkKey near{key.north + n, key.east + e};
        if (surface.store_.chunk(near) == nullptr) continue;
        surface.refreshSplit(near);
        split_[near] = &surface.cache_.at(near).split;
      }
  }

  ChunkMesh build() {
    cell(kChunkCode, origin_, false);
    for (auto& vertex : mesh_.vertices) vertex.normal = normalAt(vertex);
    return std::move(mesh_);
  }

 private:
  [[nodiscard]] bool isSplit(int code, Place p) const {
    const auto found = split_.find(chunkAt(p));
    return found != split_.end() && found->second->count(cellId(code, p)) > 0;
  }

  // `filled`: a coarser cell around this one has all corners, so that every place in it has a height.
  void cell(int code, Place p, bool filled) {
    const int corners = code <= kCoarsestCode && nodes_.hasLevel(code) ? nodes_.corners(code, p) : 0;
    filled = filled || corners == 4;
    if (code > 0 && isSplit(code, p)) {
      const Unit half = Unit{1} << (code - 1);
      for (const Place child : {p, Place{p.north, p.east + half}, Place{p.north + half, p.east},
                                Place{p.north + half, p.east + half}})
        cell(code - 1, child, filled);
    } else if (filled) {
      leaf(code, p, 0xF);
    } else if (corners == 3) {
      unsigned mask = 0;
      const auto places = cornersOf(code, p);
      for (unsigned i = 0; i < 4; ++i)
        if (nodes_.isReceived(code, places[i])) mask |= 1U << i;
      leaf(code, p, mask);
    }
  }

  // Counter-clockwise seen from above, from the south-west.
  static std::array<Place, 4> cornersOf(int code, Place p) {
    const Unit s = Unit{1} << code;
    return {p, Place{p.north, p.east + s}, Place{p.north + s, p.east + s}, Place{p.north + s, p.east}};
  }

  // The places between a and b that a cell on either side has as a corner, in order.
  void edge(int code, Place a, Place b, std::vector<Place>& out) const {
    if (code == 0) return;
    const Place low{std::min(a.north, b.north), std::min(a.east, b.east)};
    const Unit s = Unit{1} << code;
    const Place other = a.north == b.north ? Place{low.north - s, low.east} : Place{low.north, low.east - s};
    if (!isSplit(code, low) && !isSplit(code, other)) return;
    const Place middle{(a.north + b.north) / 2, (a.east + b.east) / 2};
    edge(code - 1, a, middle, out);
    if (nodes_.at(middle)) out.push_back(middle);
    edge(code - 1, middle, b, out);
  }

  void leaf(int code, Place p, unsigned mask) {
    const auto corners = cornersOf(code, p);
    std::vector<Place> ring;
    bool plain = true;
    for (unsigned i = 0; i < 4; ++i) {
      if ((mask >> i & 1U) == 0) continue;
      ring.push_back(corners[i]);
      const unsigned next = (i + 1) % 4;
      if ((mask >> next & 1U) == 0) continue;
      const std::size_t before = ring.size();
      edge(code, corners[i], corners[next], ring);
      plain = plain && ring.size() == before;
    }
    const double s = metres(Unit{1} << code);
    mesh_.area += mask == 0xF ? s * s : s * s / 2;
    std::vector<std::uint32_t> index;
    for (const Place& place : ring) index.push_back(vertex(place));
    if (plain && index.size() == 4) {  // along the shorter diagonal in depth, which follows ridges better
      const auto depth = [&](std::size_t i) { return mesh_.vertices[index[i]].point.depth; };
      const std::size_t turn = std::abs(depth(0) - depth(2)) <= std::abs(depth(1) - depth(3)) ? 0 : 1;
      mesh_.triangles.push_back({index[turn], index[turn + 1], index[turn + 2]});
      mesh_.triangles.push_back({index[turn], index[turn + 2], index[(turn + 3) % 4]});
    } else if (plain) {
      mesh_.triangles.push_back({index[0], index[1], index[2]});
    } else {
      const std::uint32_t centre = centreOf(code, p, mask);
      const bool open = mask != 0xF;  // the edge of a half cell runs through its centre
      for (std::size_t i = 0; i < index.size(); ++i) {
        const std::size_t next = (i + 1) % index.size();
        if (open && opposite(ring[i], ring[next], code)) continue;
        mesh_.triangles.push_back({index[i], index[next], centre});
      }
    }
  }

  static bool opposite(Place a, Place b, int code) {
    const Unit s = Unit{1} << code;
    return std::abs(a.north - b.north) == s && std::abs(a.east - b.east) == s;
  }

  // A fan needs a vertex inside its cell; a whole cell with split edges is at least two units wide.
  std::uint32_t centreOf(int code, Place p, unsigned mask) {
    const Unit half = Unit{1} << (code - 1);
    const Place middle{p.north + half, p.east + half};
    if (mask == 0xF) return vertex(middle);
    const auto corners = cornersOf(code, p);
    const bool rising = (mask & 0x5U) == 0x5U;  // the long side runs from south-west to north-east
    MapSurfacePoint a = *nodes_.at(corners[rising ? 0 : 1]), b = *nodes_.at(corners[rising ? 2 : 3]);
    MapSurfacePoint point = between({a, b, b, a}, 0, 0.5);
    point.interpolated = true;
    return vertex(middle, point);
  }

  std::uint32_t vertex(Place place) { return vertex(place, *nodes_.at(place)); }

  std::uint32_t vertex(Place place, const MapSurfacePoint& point) {
    const auto n = static_cast<std::uint32_t>(place.north - origin_.north);
    const auto e = static_cast<std::uint32_t>(place.east - origin_.east);
    const auto [at, is_new] = index_.try_emplace(n * kVertexRow + e, mesh_.vertices.size());
    if (is_new)
      mesh_.vertices.push_back({static_cast<std::uint16_t>(n), static_cast<std::uint16_t>(e), point, {}});
    return at->second;
  }

  // From the slopes to the neighbouring nodes of the spacing that the vertex comes from.
  [[nodiscard]] std::array<float, 3> normalAt(const ChunkMesh::Vertex& v) const {
    const Unit s = Unit{1} << v.point.spacing;
    const Place p{origin_.north + v.north, origin_.east + v.east};
    const auto slope = [&](Unit dn, Unit de) {
      const auto before = nodes_.at({p.north - dn, p.east - de}),
                 after = nodes_.at({p.north + dn, p.east + de});
      const int spans = int{before.has_value()} + int{after.has_value()};
      if (spans == 0) return 0.0;
      return ((after ? after->depth : v.point.depth) - (before ? before->depth : v.point.depth)) /
             (spans * metres(s));
    };
    const double north = slope(s, 0), east = slope(0, s);
    const double length = std::sqrt(north * north + east * east + 1);
    return {static_cast<float>(north / length), static_cast<float>(east / length),
            static_cast<float>(-1 / length)};
  }

  SurfaceNodes nodes_;
  Place origin_;
  std::map<ChunkKey, const Cells*> split_;
  ChunkMesh mesh_;
  std::unordered_map<std::uint32_t, std::uint32_t> index_;
};

void Surface::refreshSplit(ChunkKey key) {
  const BlockStore::Chunk& chunk = *store_.chunk(key);
  Cached& cached = cache_[key];
  if (cached.split_version == chunk.version) return;
  cached.split_version = chunk.version;
  cached.split.clear();
  const SurfaceNodes nodes(store_, key);
  for (int code = 0; code < kLevels; ++code) {
    for (const auto& [slot, stored] : chunk.levels[static_cast<std::size_t>(code)]) {
      const Unit s = Unit{1} << code;
      for (int i = -1; i < telemetry::MapBlock::kSide; ++i) {
        for (int j = -1; j < telemetry::MapBlock::kSide; ++j) {
          const Place p{(stored.block.key.north * telemetry::MapBlock::kSide + i) * s,
                        (stored.block.key.east * telemetry::MapBlock::kSide + j) * s};
          if (chunkAt(p) != key || nodes.corners(code, p) < 3) continue;
          for (int up = code + 1; up <= kChunkCode; ++up)
            if (!cached.split.insert(cellId(up, p)).second) break;
        }
      }
    }
  }
}

const ChunkMesh& Surface::mesh(ChunkKey key) {
  if (generation_ != store_.generation()) {
    generation_ = store_.generation();
    std::erase_if(cache_, [&](const auto& entry) { return store_.chunk(entry.first) == nullptr; });
  }
  const std::uint64_t version = store_.chunk(key)->version;
  Cached& cached = cache_[key];
  if (cached.mesh.version != version) {
    cached.mesh = Builder(*this, key).build();
    cached.mesh.version = version;
  }
  return cached.mesh;
}

double Surface::area() {
  double sum = 0;
  for (const auto& [key, chunk] : store_.chunks()) sum += mesh(key).area;
  return sum;
}

Mesh Surface::whole() {
  Mesh whole;
  for (const auto& [key, chunk] : store_.chunks()) {
    const ChunkMesh& part = mesh(key);
    const auto first = static_cast<std::uint32_t>(whole.vertices.size());
    for (const auto& v : part.vertices) {
      whole.vertices.emplace_back(static_cast<float>(key.north * kChunkSize_m + metres(v.north)),
                                  static_cast<float>(key.east * kChunkSize_m + metres(v.east)),
                                  static_cast<float>(v.point.depth));
      Rgb colour = kNoColour;
      if (v.point.has_colour)
        for (std::size_t k = 0; k < 3; ++k)
          colour[k] = static_cast<std::uint8_t>(std::lround(v.point.colour[k]));
      whole.colours.push_back(colour);
      whole.sigma.push_back(static_cast<float>(v.point.sigma));
      whole.normals.emplace_back(v.normal[0], v.normal[1], v.normal[2]);
    }
    for (const auto& t : part.triangles)
      whole.triangles.push_back({first + t[0], first + t[1], first + t[2]});
  }
  return whole;
}

std::optional<MapSurfacePoint> Surface::sample(double north, double east) const {
  if (!(std::abs(north) < kMaxHorizontal_m && std::abs(east) < kMaxHorizontal_m)) return std::nullopt;
  const double n = north * kUnitsPerMetre, e = east * kUnitsPerMetre;
  const Place p{static_cast<Unit>(std::floor(n)), static_cast<Unit>(std::floor(e))};
  const SurfaceNodes nodes(store_, chunkAt(p));
  for (int code = 0; code < kLevels; ++code) {
    if (!nodes.hasLevel(code)) continue;
    const Unit s = Unit{1} << code;
    const Place corner{p.north & ~(s - 1), p.east & ~(s - 1)};
    const double fn = (n - corner.north) / s, fe = (e - corner.east) / s;
    const auto places =
        std::array{corner, Place{corner.north, corner.east + s}, Place{corner.north + s, corner.east + s},
                   Place{corner.north + s, corner.east}};
    std::array<std::optional<MapSurfacePoint>, 4> c;
    int seen = 0;
    std::size_t missing = 0;
    for (std::size_t i = 0; i < 4; ++i) {
      c[i] = nodes.received(code, places[i]);
      if (c[i])
        ++seen;
      else
        missing = i;
    }
    if (seen == 4) return between({*c[0], *c[1], *c[2], *c[3]}, fn, fe);
    if (seen < 3) continue;
    // The plane through three corners, between them: the fourth completes the parallelogram.
    const double from_missing_n = missing < 2 ? fn : 1 - fn;
    const double from_missing_e = missing == 0 || missing == 3 ? fe : 1 - fe;
    if (from_missing_n + from_missing_e < 1) continue;
    const auto &left = c[(missing + 3) % 4], &right = c[(missing + 1) % 4], &far = c[(missing + 2) % 4];
    c[missing] = *left;
    c[missing]->depth = left->depth + right->depth - far->depth;
    for (std::size_t k = 0; k < 3; ++k)
      c[missing]->colour[k] = left->colour[k] + right->colour[k] - far->colour[k];
    MapSurfacePoint point = between({*c[0], *c[1], *c[2], *c[3]}, fn, fe);
    for (double& channel : point.colour) channel = std::clamp(channel, 0.0, 255.0);
    return point;
  }
  return std::nullopt;
}

}  // namespace fathom::monitor
