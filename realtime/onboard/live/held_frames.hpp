#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "realtime/onboard/live/input_rings.hpp"
#include "realtime/onboard/onboard_system.hpp"

namespace fathom::onboard {

// The soft tier's frames: those whose stamps wait in the sequence, or whose pair has not been mapped.
// Bounded: a frame that finds no partner is given back when newer ones need its place, before the camera's
// pool runs dry.
class HeldFrames {
 public:
  // Rings and cameras must outlive it. `most`: frames held of a camera, well below its pool's blocks.
  HeldFrames(FrameRing& left_ring, io::CameraSource& left, FrameRing& right_ring, io::CameraSource& right,
             std::size_t most);
  ~HeldFrames();
  HeldFrames(const HeldFrames&) = delete;
  HeldFrames& operator=(const HeldFrames&) = delete;

  // The pixels of an exposure by its file's name; std::nullopt when they are gone.
  [[nodiscard]] std::optional<ImageView> find(const std::string& file_name, CameraSide side);
  // When the later image of a pair was here (vehicle time).
  [[nodiscard]] std::optional<std::int64_t> arrivalOf(const std::string& left_image,
                                                      const std::string& right_image);
  // A pair was mapped or dropped: its frames and all older ones of each camera are given back.
  void release(const std::string& left_image, const std::string& right_image);
  // Takes in what the cameras gave; frames beyond `most` go, the oldest first.
  void refill();

  [[nodiscard]] std::uint64_t givenBackUnused() const { return unused_; }
  [[nodiscard]] std::size_t held() const { return sides_[0].count + sides_[1].count; }

 private:
  static constexpr std::size_t kMost = 32;
  struct Side {
    FrameRing* ring = nullptr;
    io::CameraSource* camera = nullptr;
    std::array<io::CameraFrame, kMost> frames;  // oldest first
    std::size_t count = 0;
  };
  [[nodiscard]] static const io::CameraFrame* frameOf(const Side& side, const std::string& file_name);
  void dropOldest(Side& side, std::size_t frames);
  void releaseUpTo(Side& side, const std::string& file_name);

  std::array<Side, 2> sides_;
  std::size_t most_;
  std::uint64_t unused_ = 0;
};

}  // namespace fathom::onboard
