#include "recon/fusion/cell_statistics.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <stdexcept>

namespace fathom::fusion {
namespace {

constexpr double kQuantum = 1.0 / 16384;  // of a depth [m]
constexpr double kCovered = 0.5;          // of a cell's plan, for it to count
constexpr std::array<char, 8> kMagic = {'F', 'C', 'E', 'L', 'L', 'S', '0', '1'};

// A cell as one number, ordered by x, then y.
std::uint64_t keyOf(std::int32_t x, std::int32_t y) {
  constexpr std::uint32_t kSign = 0x80000000U;
  return (static_cast<std::uint64_t>(static_cast<std::uint32_t>(x) ^ kSign) << 32) |
         (static_cast<std::uint32_t>(y) ^ kSign);
}
std::int32_t half(std::uint64_t bits) {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(bits) ^ 0x80000000U);
}

// A triangle cut by four lines has at most seven corners.
struct Polygon {
  Polygon() {}  // corners are set as they come: most are never used
  Polygon(const Polygon& other) : corners(other.corners) {
    std::copy_n(other.corner.begin(), corners, corner.begin());
  }
  Polygon& operator=(const Polygon& other) {
    corners = other.corners;
    std::copy_n(other.corner.begin(), corners, corner.begin());
    return *this;
  }
  ~Polygon() = default;
  std::array<Eigen::Vector3d, 8> corner;
  int corners = 0;
  void add(const Eigen::Vector3d& p) { corner[static_cast<std::size_t>(corners++)] = p; }
};

// The part of a convex polygon on the side of `value` along an axis (Sutherland and Hodgman 1974).
Polygon clip(const Polygon& polygon, int axis, double value, bool above) {
  Polygon out;
  const double sign = above ? 1 : -1;
  for (int k = 0; k < polygon.corners; ++k) {
    const Eigen::Vector3d& a = polygon.corner[static_cast<std::size_t>(k)];
    const Eigen::Vector3d& b = polygon.corner[static_cast<std::size_t>((k + 1) % polygon.corners)];
    const double da = sign * (a[axis] - value), db = sign * (b[axis] - value);
    if (da >= 0) out.add(a);
    if ((da > 0 && db < 0) || (da < 0 && db > 0)) out.add(a + (b - a) * (da / (da - db)));
  }
  return out;
}

void put(std::vector<std::uint8_t>& bytes, const auto& value) {
  const auto* from = reinterpret_cast<const std::uint8_t*>(&value);
  bytes.insert(bytes.end(), from, from + sizeof value);
}
template <typename T>
T take(const std::uint8_t*& at) {
  T value;
  std::memcpy(&value, at, sizeof value);
  at += sizeof value;
  return value;
}

}  // namespace

// The part of one mesh in a cell.
struct CellStatistics::Share {
  double area = 0, volume = 0;  // in plan [cell^2], and times depth
  void add(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
    const double part = 0.5 * std::abs((b.x() - a.x()) * (c.y() - a.y()) - (b.y() - a.y()) * (c.x() - a.x()));
    area += part;
    volume += part * (a.z() + b.z() + c.z()) / 3;
  }
};

CellStatistics::CellStatistics(double cell) : cell_(cell) {
  if (!(cell > 0) || !std::isfinite(cell)) throw std::invalid_argument("cell size must be above zero");
}

// Triangle: north and east in cells, depth in metres.
void CellStatistics::cut(const std::array<Eigen::Vector3d, 3>& triangle, Shares& shares) {
  const Eigen::Vector3d low = triangle[0].cwiseMin(triangle[1]).cwiseMin(triangle[2]);
  const Eigen::Vector3d high = triangle[0].cwiseMax(triangle[1]).cwiseMax(triangle[2]);
  if ((high - low).head<2>().maxCoeff() > kMaxSpan) return;
  const auto floorOf = [](double v) { return static_cast<std::int32_t>(std::floor(v)); };
  const std::int32_t x0 = floorOf(low.x()), x1 = floorOf(high.x()), y0 = floorOf(low.y()),
                     y1 = floorOf(high.y());
  if (x0 == x1 && y0 == y1) {
    shares[keyOf(x0, y0)].add(triangle[0], triangle[1], triangle[2]);
    return;
  }
  Polygon whole;
  for (const Eigen::Vector3d& p : triangle) whole.add(p);
  for (std::int32_t x = x0; x <= x1; ++x) {
    Polygon row = whole;
    if (x > x0) row = clip(row, 0, x, true);
    if (x < x1) row = clip(row, 0, x + 1, false);
    for (std::int32_t y = y0; y <= y1 && row.corners > 2; ++y) {
      Polygon part = row;
      if (y > y0) part = clip(part, 1, y, true);
      if (y < y1) part = clip(part, 1, y + 1, false);
      if (part.corners < 3) continue;
      Share& share = shares[keyOf(x, y)];
      for (int k = 2; k < part.corners; ++k)
        share.add(part.corner[0], part.corner[static_cast<std::size_t>(k - 1)],
                  part.corner[static_cast<std::size_t>(k)]);
    }
  }
}

void CellStatistics::add(const Mesh& mesh) {
  Shares shares;
  for (const auto& t : mesh.triangles) {
    std::array<Eigen::Vector3d, 3> triangle;
    bool usable = true;
    for (std::size_t k = 0; k < 3 && usable; ++k) {
      triangle[k] = mesh.vertices[t[k]].cast<double>();
      usable = triangle[k].allFinite() && triangle[k].cwiseAbs().maxCoeff() < kReach;
      triangle[k].head<2>() /= cell_;
      usable = usable && triangle[k].head<2>().cwiseAbs().maxCoeff() < 1e9;  // fits in 32 bits
    }
    if (usable) cut(triangle, shares);
  }
  for (const auto& [key, share] : shares) {  // in any order: each cell has its own sums
    if (share.area < kCovered) continue;
    const auto z = static_cast<std::int64_t>(std::llround(share.volume / share.area / kQuantum));
    Sums& cell = sums_[key];
    ++cell.meshes;
    cell.z += z;
    cell.zz += static_cast<Wide>(z * z);  // below (kReach / kQuantum)^2 < 2^63
  }
}

void CellStatistics::merge(const CellStatistics& other) {
  if (other.cell_ != cell_) throw std::invalid_argument("statistics of another cell size");
  for (const auto& [key, theirs] : other.sums_) {
    Sums& ours = sums_[key];
    ours.meshes += theirs.meshes;
    ours.z += theirs.z;
    ours.zz += theirs.zz;
  }
}

CellStatistics::Cell CellStatistics::cellOf(std::uint64_t key, const Sums& sums) {
  Cell cell{half(key >> 32), half(key & 0xFFFFFFFFU), sums.meshes, 0, 0};
  const double n = sums.meshes;
  cell.mean_z = static_cast<double>(sums.z) / n * kQuantum;
  if (sums.meshes > 1) {
    const Wide square = static_cast<Wide>(static_cast<__int128>(sums.z) * sums.z);
    const Wide spread = static_cast<Wide>(sums.meshes) * sums.zz - square;
    cell.deviation = std::sqrt(static_cast<double>(spread) / (n * (n - 1))) * kQuantum;
  }
  return cell;
}

std::vector<std::uint64_t> CellStatistics::keys() const {
  std::vector<std::uint64_t> out;
  out.reserve(sums_.size());
  for (const auto& [key, sums] : sums_) out.push_back(key);
  std::sort(out.begin(), out.end());
  return out;
}

std::vector<CellStatistics::Cell> CellStatistics::cells() const {
  std::vector<Cell> out;
  out.reserve(sums_.size());
  for (const std::uint64_t key : keys()) out.push_back(cellOf(key, sums_.at(key)));
  return out;
}

std::optional<CellStatistics::Cell> CellStatistics::at(double north, double east) const {
  if (!(std::abs(north) < kReach && std::abs(east) < kReach)) return std::nullopt;
  const double x = std::floor(north / cell_), y = std::floor(east / cell_);
  if (!(std::abs(x) < 1e9 && std::abs(y) < 1e9)) return std::nullopt;
  const auto found = sums_.find(keyOf(static_cast<std::int32_t>(x), static_cast<std::int32_t>(y)));
  if (found == sums_.end()) return std::nullopt;
  return cellOf(found->first, found->second);
}

std::vector<std::uint8_t> CellStatistics::save() const {
  std::vector<std::uint8_t> bytes;
  put(bytes, kMagic);
  put(bytes, cell_);
  put(bytes, static_cast<std::uint64_t>(sums_.size()));
  for (const std::uint64_t key : keys()) {
    const Sums& sums = sums_.at(key);
    put(bytes, key);
    put(bytes, sums.meshes);
    put(bytes, sums.z);
    put(bytes, sums.zz);
  }
  return bytes;
}

bool CellStatistics::load(const std::vector<std::uint8_t>& bytes) {
  constexpr std::size_t kHead = sizeof kMagic + sizeof(double) + sizeof(std::uint64_t);
  constexpr std::size_t kEntry =
      sizeof(std::uint64_t) + sizeof(std::uint32_t) + sizeof(std::int64_t) + sizeof(Wide);
  if (bytes.size() < kHead || (bytes.size() - kHead) % kEntry != 0) return false;
  const std::uint8_t* from = bytes.data();
  if (take<std::array<char, 8>>(from) != kMagic) return false;
  const auto cell = take<double>(from);
  if (!(cell > 0) || !std::isfinite(cell)) return false;
  const auto count = take<std::uint64_t>(from);
  if (count != (bytes.size() - kHead) / kEntry) return false;
  std::unordered_map<std::uint64_t, Sums> sums;
  sums.reserve(count);
  std::uint64_t last = 0;
  for (std::uint64_t k = 0; k < count; ++k) {
    const auto key = take<std::uint64_t>(from);
    Sums entry;
    entry.meshes = take<std::uint32_t>(from);
    entry.z = take<std::int64_t>(from);
    entry.zz = take<Wide>(from);
    if (entry.meshes == 0 || (k > 0 && key <= last)) return false;
    // Sums of depths satisfy n * sum of squares >= square of sum.
    const Wide square = static_cast<Wide>(static_cast<__int128>(entry.z) * entry.z);
    if (entry.zz > (~static_cast<Wide>(0)) / entry.meshes || entry.meshes * entry.zz < square) return false;
    sums.emplace(key, entry);
    last = key;
  }
  cell_ = cell;
  sums_ = std::move(sums);
  return true;
}

}  // namespace fathom::fusion
