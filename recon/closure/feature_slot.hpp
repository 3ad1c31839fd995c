#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "recon/closure/frame_features.hpp"

namespace fathom::closure {

// One frame's features as a block of fixed size, for a preallocated file of equal slots:
//   u32 magic "FCL1", u8 kind, u8 zero, u16 count, count records, then zeros up to the slot's size.
// A record: left x y, right x y, point x y z, covariance of 6, size (14 f32), then the descriptor. Little
// endian. 600 features of 128 bytes: 110,408 bytes; of 32 bytes (ORB): 52,808.
constexpr std::size_t kSlotHeaderBytes = 8;
constexpr std::size_t kSlotFloats = 14;
constexpr std::size_t kMaxSlotFeatures = 65535;

[[nodiscard]] std::size_t slotBytes(DescriptorKind kind, std::size_t max_features);

// False, leaving `slot` as it was, when the features do not fit in.
[[nodiscard]] bool writeSlot(const FrameFeatures& frame, std::span<std::uint8_t> slot);

// False, leaving `frame` empty, for bytes that are no slot: wrong magic, unknown kind, a count beyond the
// block, numbers that are not finite, points not in front of the camera, covariances not positive.
[[nodiscard]] bool readSlot(std::span<const std::uint8_t> slot, FrameFeatures& frame);

}  // namespace fathom::closure
