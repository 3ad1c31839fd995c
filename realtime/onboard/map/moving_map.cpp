#include "realtime/onboard/map/moving_map.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "realtime/base/numbers/hash64.hpp"

namespace fathom::onboard {
namespace {

static_assert(std::endian::native == std::endian::little, "slots are copies of memory");

constexpr std::uint32_t kMagic = 0x314D4C46;  // "FLM1"
struct Header {
  std::uint32_t magic = kMagic;
  std::uint16_t vertices = 0, zero = 0;
  std::uint32_t triangles = 0;
};
using Corner = std::array<float, 4>;
using Triangle = std::array<std::uint16_t, 3>;
constexpr std::size_t kVertexBytes = sizeof(Corner) + sizeof(Rgb);
static_assert(sizeof(Header) == 12 && sizeof(Triangle) == 6 && sizeof(Rgb) == 3);

std::size_t slotBytesFor(std::size_t vertices, std::size_t triangles) {
  return sizeof(Header) + vertices * kVertexBytes + triangles * sizeof(Triangle);
}

template <typename T>
std::uint8_t* put(std::uint8_t* to, const T& value) {
  std::memcpy(to, &value, sizeof(T));
  return to + sizeof(T);
}

template <typename T>
const std::uint8_t* take(const std::uint8_t* from, T& value) {
  std::memcpy(&value, from, sizeof(T));
  return from + sizeof(T);
}

// Meshes that cannot be read again stay where they are; a few are covered by their neighbours.
constexpr double kMostLost = 0.02;  // of all meshes
// Smaller moves of a mesh's middle or rim are far below what stereo sees [m].
constexpr double kMoved = 0.002;
// Steps of urgency to a doubling of the move.
constexpr double kUrgencySteps = 8;
// Meshes compared with their poses a frame, so that a move of all costs no frame much (about 0.1 us each).
constexpr std::size_t kCompared = 2048;

MovingMap::Box boxOf(const Mesh& mesh) {
  MovingMap::Box box;
  if (mesh.vertices.empty()) return box;
  box.low.setConstant(std::numeric_limits<float>::max());
  box.high = -box.low;
  for (const Eigen::Vector3f& v : mesh.vertices) {
    box.low = box.low.cwiseMin(v.head<2>());
    box.high = box.high.cwiseMax(v.head<2>());
  }
  return box;
}

std::uint64_t hashOf(std::span<const std::uint8_t> bytes) {
  std::uint64_t hash = bytes.size();
  for (std::size_t at = 0; at < bytes.size(); at += sizeof(std::uint64_t)) {
    std::uint64_t word = 0;
    std::memcpy(&word, bytes.data() + at, std::min(sizeof word, bytes.size() - at));
    hash = hash64(hash ^ word);
  }
  return hash;
}

bool same(const SE3& a, const SE3& b) {
  return a.translation() == b.translation() && a.rotation().coeffs() == b.rotation().coeffs();
}

void reserve(Mesh& mesh, std::size_t points) {
  mesh.vertices.reserve(points);
  mesh.sigma.reserve(points);
  mesh.colours.reserve(points);
  mesh.triangles.reserve(2 * points);
}

std::size_t memoryOf(const Mesh& mesh) {
  return mesh.vertices.capacity() * sizeof(mesh.vertices[0]) + mesh.sigma.capacity() * sizeof(float) +
         mesh.colours.capacity() * sizeof(Rgb) + mesh.triangles.capacity() * sizeof(mesh.triangles[0]);
}

}  // namespace

std::size_t meshSlotBytes(std::size_t max_points) {
  return slotBytesFor(max_points, 2 * max_points);
}

std::size_t writeMeshSlot(const Mesh& mesh, std::span<std::uint8_t> slot) {
  const std::size_t vertices = mesh.vertices.size(), bytes = slotBytesFor(vertices, mesh.triangles.size());
  if (vertices > std::numeric_limits<std::uint16_t>::max() || bytes > slot.size() ||
      mesh.sigma.size() != vertices || mesh.colours.size() != vertices)
    return 0;
  Header header;
  header.vertices = static_cast<std::uint16_t>(vertices);
  header.triangles = static_cast<std::uint32_t>(mesh.triangles.size());
  std::uint8_t* to = put(slot.data(), header);
  for (std::size_t i = 0; i < vertices; ++i) {
    const Eigen::Vector3f& v = mesh.vertices[i];
    to = put(to, Corner{v.x(), v.y(), v.z(), mesh.sigma[i]});
  }
  for (const auto& t : mesh.triangles)
    to = put(to, Triangle{static_cast<std::uint16_t>(t[0]), static_cast<std::uint16_t>(t[1]),
                          static_cast<std::uint16_t>(t[2])});
  for (const Rgb& c : mesh.colours) to = put(to, c);
  return bytes;
}

bool readMeshSlot(std::span<const std::uint8_t> slot, Mesh& mesh) {
  mesh.vertices.clear();
  mesh.normals.clear();
  mesh.colours.clear();
  mesh.texture_coordinates.clear();
  mesh.sigma.clear();
  mesh.triangles.clear();
  Header header;
  if (slot.size() < sizeof(Header)) return false;
  const std::uint8_t* from = take(slot.data(), header);
  if (header.magic != kMagic || slotBytesFor(header.vertices, header.triangles) > slot.size()) return false;
  for (std::size_t i = 0; i < header.vertices; ++i) {
    Corner c;
    from = take(from, c);
    mesh.vertices.emplace_back(c[0], c[1], c[2]);
    mesh.sigma.push_back(c[3]);
  }
  for (std::size_t i = 0; i < header.triangles; ++i) {
    Triangle t;
    from = take(from, t);
    mesh.triangles.push_back({t[0], t[1], t[2]});
  }
  for (std::size_t i = 0; i < header.vertices; ++i) {
    Rgb c;
    from = take(from, c);
    mesh.colours.push_back(c);
  }
  return true;
}

MovingMap::MovingMap(const fusion::QuadtreeConfig& config, SlotStore* meshes, std::size_t max_points,
                     const calibration::RigHistory& rigs)
    : map_(config), meshes_(meshes != nullptr && meshes->slots() > 0 ? meshes : nullptr), rigs_(rigs) {
  if (meshes_ == nullptr) return;
  entries_.reserve(meshes_->slots());
  keyframe_.reserve(meshes_->slots());
  fused_.reserve(meshes_->slots());
  urgency_.reserve(meshes_->slots());
  block_.resize(meshSlotBytes(max_points));
  reserve(mesh_, max_points);
  reserve(moved_, max_points);
}

std::size_t MovingMap::memoryBytes() const {
  return sizeof(*this) - sizeof(map_) + map_.counters().memory_bytes + entries_.capacity() * sizeof(Entry) +
         (keyframe_.capacity() + fused_.capacity()) * sizeof(int) + urgency_.capacity() + block_.capacity() +
         memoryOf(mesh_) + memoryOf(moved_);
}

MovingMap::Added MovingMap::add(Mesh& mesh, int keyframe, const SE3& T_odom_cam, const SE3& T_nav_cam) {
  ++counters_.meshes;
  if (meshes_ == nullptr) {
    transform(mesh, T_nav_cam);
    return {map_.fuse(mesh), 0};
  }
  const std::size_t slot = slotFor();
  Entry entry;
  entry.T_odom_cam = T_odom_cam;
  entry.shown = T_nav_cam;
  entry.rig = entry.shown_rig = rigs_.newest();
  const std::size_t bytes = writeMeshSlot(mesh, block_);
  entry.bytes = static_cast<std::uint32_t>(bytes);
  entry.hash = hashOf({block_.data(), bytes});
  entry.stored = bytes > 0 && meshes_->write(slot, {block_.data(), bytes});
  if (!entry.stored) ++counters_.meshes_lost;
  Eigen::AlignedBox3f extent;
  for (const Eigen::Vector3f& v : mesh.vertices) extent.extend(v);
  entry.middle = mesh.vertices.empty() ? Eigen::Vector3f::Zero() : Eigen::Vector3f(extent.center());
  entry.radius = mesh.vertices.empty() ? 0 : extent.diagonal().norm() / 2;
  transform(mesh, T_nav_cam);
  entry.box = boxOf(mesh);
  const std::size_t cells = map_.fuse(mesh);
  entry.fused = cells > 0;
  entries_[slot] = entry;
  keyframe_[slot] = keyframe;
  fused_[slot] = ++fusions_;
  return {cells, slot};
}

void MovingMap::correct(std::size_t slot, const SE3& guessed, int keyframe, const SE3& T_odom_cam,
                        const PoseOf& pose_of) {
  if (slot >= entries_.size() || !same(entries_[slot].T_odom_cam, guessed)) return;
  keyframe_[slot] = keyframe;
  entries_[slot].T_odom_cam = T_odom_cam;
  if (entries_[slot].stored) compare(slot, pose_of);
}

// A slot that is free, or that of the mesh that has not moved for longest, of one that need not move if
// there is any.
std::size_t MovingMap::slotFor() {
  if (entries_.size() < entries_.capacity()) {
    entries_.emplace_back();
    keyframe_.push_back(-1);
    fused_.push_back(0);
    urgency_.push_back(0);
    return entries_.size() - 1;
  }
  std::size_t stillest = 0;
  for (std::size_t k = 1; k < fused_.size(); ++k) {
    const bool moves = urgency_[k] > 0, did_move = urgency_[stillest] > 0;
    if (moves != did_move ? did_move : fused_[k] < fused_[stillest]) stillest = k;
  }
  setUrgency(stillest, 0);
  ++counters_.meshes_baked_in;
  return stillest;
}

void MovingMap::reattach(const slam::NavigationGraph::Retired& gone) {
  for (std::size_t k = 0; k < keyframe_.size(); ++k) {
    if (keyframe_[k] != gone.keyframe) continue;
    keyframe_[k] = gone.onto;
    entries_[k].T_odom_cam = gone.T_onto * entries_[k].T_odom_cam;
  }
}

bool MovingMap::noteMoved() {
  if (entries_.empty()) return false;
  if (to_compare_ == 0) cursor_ = entries_.size();
  to_compare_ = entries_.size();
  return true;
}

void MovingMap::setUrgency(std::size_t k, std::uint8_t urgency) {
  waiting_ += (urgency > 0 ? 1U : 0U);
  waiting_ -= (urgency_[k] > 0 ? 1U : 0U);
  urgency_[k] = urgency;
}

void MovingMap::compareSome(std::size_t most, const PoseOf& pose_of) {
  for (; most > 0 && to_compare_ > 0; --most, --to_compare_) {
    if (cursor_ == 0) cursor_ = entries_.size();
    if (entries_[--cursor_].stored) compare(cursor_, pose_of);
  }
}

void MovingMap::compare(std::size_t k, const PoseOf& pose_of) {
  const Entry& e = entries_[k];
  const SE3 now = pose_of(keyframe_[k], e.T_odom_cam);
  const auto middle = [&](int rig) {
    const Eigen::Vector3d seen = e.middle.cast<double>();
    return rig == e.rig ? seen : calibration::retriangulated(rigs_.rig(e.rig), rigs_.rig(rig), seen);
  };
  const double turned = now.rotation().angularDistance(e.shown.rotation());
  const double moved = (now * middle(rigs_.best(e.rig)) - e.shown * middle(e.shown_rig)).norm() +
                       turned * static_cast<double>(e.radius);
  const double steps = moved < kMoved ? 0 : 1 + kUrgencySteps * std::log2(moved / kMoved);
  setUrgency(k, static_cast<std::uint8_t>(std::min(255.0, steps)));
}

// A disk that gives back other bytes than were written would take out what never went in.
bool MovingMap::readBlock(std::size_t k) {
  const Entry& e = entries_[k];
  const std::span<std::uint8_t> bytes(block_.data(), e.bytes);
  return meshes_->read(k, bytes) && hashOf(bytes) == e.hash;
}

bool MovingMap::readMesh(std::size_t k) {
  return readBlock(k) && readMeshSlot(std::span(block_).first(entries_[k].bytes), mesh_);
}

bool MovingMap::slotsHold() {
  for (std::size_t k = 0; k < entries_.size(); ++k)
    if (entries_[k].stored && !readBlock(k)) return false;
  return true;
}

void MovingMap::through(int from, int to, Mesh& mesh) const {
  if (from != to) calibration::retriangulate(rigs_.rig(from), rigs_.rig(to), mesh);
}

bool MovingMap::move(std::size_t k, const SE3& T_nav_cam, const OnMoved& on_moved) {
  Entry& e = entries_[k];
  setUrgency(k, 0);
  if (!readMesh(k)) {
    e.stored = false;
    ++counters_.meshes_lost;
    return false;
  }
  moved_ = mesh_;
  if (e.fused) {
    through(e.rig, e.shown_rig, mesh_);
    transform(mesh_, e.shown);
    (void)map_.remove(mesh_);
  }
  e.shown_rig = rigs_.best(e.rig);
  through(e.rig, e.shown_rig, moved_);
  transform(moved_, T_nav_cam);
  const Box before = e.box;
  e.box = boxOf(moved_);
  e.shown = T_nav_cam;
  e.fused = map_.fuse(moved_) > 0;
  fused_[k] = ++fusions_;
  ++counters_.meshes_fused_again;
  if (on_moved) on_moved(before, e.box);
  return true;
}

void MovingMap::rebuild(int meshes, const PoseOf& pose_of, const OnMoved& on_moved) {
  if (entries_.empty()) return;
  compareSome(kCompared, pose_of);
  const bool waited = waiting_ > 0;
  for (; meshes > 0 && waiting_ > 0; --meshes) {
    std::uint8_t most = 0;
    for (const std::uint8_t u : urgency_) most = std::max(most, u);
    std::size_t k = urgency_.size() - 1;
    while (urgency_[k] != most) --k;
    (void)move(k, pose_of(keyframe_[k], entries_[k].T_odom_cam), on_moved);
  }
  if (waited && waiting_ == 0 && to_compare_ == 0) ++counters_.rebuilds;
}

void MovingMap::finish(const PoseOf& pose_of, const OnMoved& on_moved) {
  for (std::size_t k = 0; k < entries_.size(); ++k) {
    const SE3 now = pose_of(keyframe_[k], entries_[k].T_odom_cam);
    const Entry& e = entries_[k];
    if (e.stored && (!same(now, e.shown) || rigs_.best(e.rig) != e.shown_rig)) (void)move(k, now, on_moved);
    setUrgency(k, 0);
  }
  to_compare_ = 0;
}

MovingMap::Counters MovingMap::counters() const {
  Counters out = counters_;
  out.waiting = waiting_;
  out.given_up =
      static_cast<double>(counters_.meshes_lost) > kMostLost * static_cast<double>(counters_.meshes);
  return out;
}

}  // namespace fathom::onboard
