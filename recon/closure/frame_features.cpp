#include "recon/closure/frame_features.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "recon/closure/dot_kernels.hpp"

namespace fathom::closure {
namespace {

static_assert(std::endian::native == std::endian::little, "slots are written in memory order");

constexpr std::uint32_t kMagic = 0x314C4346;  // "FCL1"
constexpr std::size_t kSlotHeaderBytes = 8;
using Record = std::array<float, 14>;

Record pack(const Feature& f) {
  const auto& c = f.covariance;
  return {f.left.x(), f.left.y(), f.right.x(), f.right.y(), f.point.x(), f.point.y(), f.point.z(),
          c[0],       c[1],       c[2],        c[3],        c[4],        c[5],        f.size};
}

Feature unpack(const Record& r) {
  return {{r[0], r[1]}, {r[2], r[3]}, {r[4], r[5], r[6]}, {r[7], r[8], r[9], r[10], r[11], r[12]}, r[13]};
}

bool plausible(const Record& r) {
  const Feature f = unpack(r);
  const Eigen::Matrix3d c = f.covarianceMatrix();
  return std::all_of(r.begin(), r.end(), [](float v) { return std::isfinite(v); }) && f.point.z() > 0 &&
         c(0, 0) > 0 && c.topLeftCorner<2, 2>().determinant() > 0 && c.determinant() > 0;
}

constexpr float kSamePlace = 4.0F;  // features so near are one place [px]
constexpr float kNone = std::numeric_limits<float>::max();

static_assert(kDotLength == kDescriptorBytes);

std::vector<std::int16_t> widened(const FrameFeatures& frame) {
  return {frame.descriptors.begin(), frame.descriptors.end()};
}

// Square of each vector's length.
Eigen::VectorXf squares(const std::vector<std::int16_t>& values) {
  const auto count = values.size() / kDotLength;
  Eigen::VectorXf out(static_cast<Eigen::Index>(count));
  for (std::size_t i = 0; i < count; ++i) {
    std::int32_t sum = 0;
    for (std::size_t k = 0; k < kDotLength; ++k) {
      const std::int32_t v = values[i * kDotLength + k];
      sum += v * v;
    }
    out(static_cast<Eigen::Index>(i)) = static_cast<float>(sum);
  }
  return out;
}

bool samePlace(const Feature& a, const Feature& b) {
  return (a.left - b.left).squaredNorm() < kSamePlace * kSamePlace;
}

// Best partner of one feature and the best one elsewhere.
struct Ranking {
  int best = -1;
  float first = kNone, second = kNone;

  void offer(int candidate, float distance, const FrameFeatures& of) {
    if (distance >= second) return;
    const bool same = best >= 0 && samePlace(of.features[static_cast<std::size_t>(candidate)],
                                             of.features[static_cast<std::size_t>(best)]);
    if (distance < first) {
      if (!same) second = first;
      first = distance;
      best = candidate;
    } else if (!same) {
      second = distance;
    }
  }
};

}  // namespace

Eigen::Matrix3d Feature::covarianceMatrix() const {
  Eigen::Matrix3f c;
  c << covariance[0], covariance[1], covariance[2], covariance[1], covariance[3], covariance[4],
      covariance[2], covariance[4], covariance[5];
  return c.cast<double>();
}

std::size_t slotBytes(std::size_t max_features) {
  return kSlotHeaderBytes + max_features * (sizeof(Record) + kDescriptorBytes);
}

bool writeSlot(const FrameFeatures& frame, std::span<std::uint8_t> slot) {
  if (frame.size() > kMaxSlotFeatures || slotBytes(frame.size()) > slot.size()) return false;
  if (frame.descriptors.size() != frame.size() * kDescriptorBytes) return false;
  const auto count = static_cast<std::uint16_t>(frame.size());
  std::memcpy(slot.data(), &kMagic, 4);
  slot[4] = kSlotKind;
  slot[5] = 0;
  std::memcpy(&slot[6], &count, 2);
  std::uint8_t* to = slot.data() + kSlotHeaderBytes;
  for (std::size_t i = 0; i < frame.size(); ++i) {
    const Record record = pack(frame.features[i]);
    std::memcpy(to, record.data(), sizeof(record));
    std::memcpy(to + sizeof(record), frame.descriptor(i), kDescriptorBytes);
    to += sizeof(record) + kDescriptorBytes;
  }
  std::fill(to, slot.data() + slot.size(), std::uint8_t{0});
  return true;
}

bool readSlot(std::span<const std::uint8_t> slot, FrameFeatures& frame) {
  frame.clear();
  if (slot.size() < kSlotHeaderBytes) return false;
  std::uint32_t magic = 0;
  std::uint16_t count = 0;
  std::memcpy(&magic, slot.data(), 4);
  std::memcpy(&count, &slot[6], 2);
  if (magic != kMagic || slot[4] != kSlotKind || slot[5] != 0 || slotBytes(count) > slot.size()) return false;
  const std::uint8_t* from = slot.data() + kSlotHeaderBytes;
  for (std::size_t i = 0; i < count; ++i, from += sizeof(Record) + kDescriptorBytes) {
    Record record;
    std::memcpy(record.data(), from, sizeof(record));
    if (!plausible(record)) {
      frame.clear();
      return false;
    }
    frame.features.push_back(unpack(record));
    const std::uint8_t* descriptor = from + sizeof(record);
    frame.descriptors.insert(frame.descriptors.end(), descriptor, descriptor + kDescriptorBytes);
  }
  return true;
}

void descriptorDistances(const FrameFeatures& a, const FrameFeatures& b, Eigen::MatrixXf& distances) {
  distances.resize(static_cast<Eigen::Index>(a.size()), static_cast<Eigen::Index>(b.size()));
  if (distances.size() == 0) return;
  const std::vector<std::int16_t> x = widened(a), y = widened(b);
  static const DotProducts products = fastestDotProducts();
  products(x.data(), static_cast<int>(a.size()), y.data(), static_cast<int>(b.size()), distances.data());
  const Eigen::VectorXf xx = squares(x), yy = squares(y);
  for (Eigen::Index j = 0; j < distances.cols(); ++j)
    distances.col(j) = (xx.array() + yy(j)) - 2 * distances.col(j).array();
}

std::vector<float> nearestElsewhere(const FrameFeatures& frame) {
  Eigen::MatrixXf distances;
  descriptorDistances(frame, frame, distances);
  std::vector<float> nearest(frame.size(), kNone);
  for (std::size_t i = 0; i < frame.size(); ++i)
    for (std::size_t j = 0; j < i; ++j) {
      const float d = distances(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(i));
      if (d >= nearest[i] && d >= nearest[j]) continue;
      if (samePlace(frame.features[i], frame.features[j])) continue;
      nearest[i] = std::min(nearest[i], d);
      nearest[j] = std::min(nearest[j], d);
    }
  return nearest;
}

void matchDescriptors(const FrameFeatures& a, const FrameFeatures& b, const Eigen::MatrixXf& distances,
                      const Eigen::Array<bool, Eigen::Dynamic, Eigen::Dynamic>* allowed,
                      const MatchConfig& config, Matches& matches) {
  matches.best.clear();
  matches.alike.clear();
  const int n = static_cast<int>(a.size()), m = static_cast<int>(b.size());
  std::vector<Ranking> of_a(a.size()), of_b(b.size());
  for (int j = 0; j < m; ++j) {
    for (int i = 0; i < n; ++i) {
      if (allowed != nullptr && !(*allowed)(i, j)) continue;
      of_a[static_cast<std::size_t>(i)].offer(j, distances(i, j), b);
      of_b[static_cast<std::size_t>(j)].offer(i, distances(i, j), a);
    }
  }
  const auto squared = static_cast<float>(config.max_ratio * config.max_ratio);
  const auto loose = static_cast<float>(1 / (config.near_tie_ratio * config.near_tie_ratio));
  std::vector<std::pair<float, int>> ties;
  for (int i = 0; i < n; ++i) {
    const Ranking& r = of_a[static_cast<std::size_t>(i)];
    if (r.best < 0) continue;
    const Ranking& back = of_b[static_cast<std::size_t>(r.best)];
    if (back.best == i && r.first < squared * r.second && back.first < squared * back.second)
      matches.best.push_back({i, r.best});
    ties.clear();
    for (int j = 0; j < m; ++j) {
      if ((allowed == nullptr || (*allowed)(i, j)) && distances(i, j) <= loose * r.first)
        ties.emplace_back(distances(i, j), j);
    }
    std::sort(ties.begin(), ties.end());
    for (std::size_t k = 0; k < ties.size() && k < static_cast<std::size_t>(config.max_alike); ++k)
      matches.alike.push_back({i, ties[k].second});
  }
}

}  // namespace fathom::closure
