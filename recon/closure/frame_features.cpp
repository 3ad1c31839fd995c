#include "recon/closure/frame_features.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>

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

}  // namespace fathom::closure
