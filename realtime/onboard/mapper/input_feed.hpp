#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "firmware_if/mission/log/onboard_input.hpp"
#include "realtime/kernel/rings/shared_blocks.hpp"
#include "realtime/onboard/mapper/mapper_channel.hpp"

namespace fathom::onboard {

// Frames that the mapper holds: those with stamps still waiting in the log, or a pair not yet mapped.
// Bounded: the oldest frame without partner is given back when a newer one needs its place. The vehicle lends
// the frames and keeps their pixels until they are given back (FrameLender), whatever the mapper does.
class HeldFrames {
 public:
  // Both cameras' pools, mapped. `most`: frames held of a camera.
  HeldFrames(const MapperDown& down, MapperUp& up, int left_pool, int right_pool, std::size_t most);
  ~HeldFrames();
  HeldFrames(const HeldFrames&) = delete;
  HeldFrames& operator=(const HeldFrames&) = delete;

  // Whether the frame of an exposure is held, by its file's name, with usable pixels or not.
  [[nodiscard]] bool has(const std::string& file_name, CameraSide side);
  // The pixels of an exposure by its file's name; std::nullopt when they are gone or not of the camera's
  // format.
  [[nodiscard]] std::optional<ImageView> find(const std::string& file_name, CameraSide side);
  // Arrival of the later image of a pair (vehicle time).
  [[nodiscard]] std::optional<std::int64_t> arrivalOf(const std::string& left_image,
                                                      const std::string& right_image);
  // A pair was mapped or dropped: gives back its frames and all older ones of each camera.
  void release(const std::string& left_image, const std::string& right_image);
  // Takes in the cameras' new frames; gives back the oldest beyond `most`.
  void refill();

  [[nodiscard]] std::uint64_t givenBackUnused() const { return unused_; }
  [[nodiscard]] std::size_t held() const { return sides_[0].count + sides_[1].count; }

 private:
  static constexpr std::size_t kMost = 32;
  struct Held {
    LentFrame lent;
    std::uint64_t number = 0;
  };
  struct Side {
    const FrameBroadcast* ring = nullptr;
    std::atomic<std::uint64_t>* floor = nullptr;
    PoolPlace place;
    std::unique_ptr<rt::SharedMemory> pool;
    std::array<Held, kMost> frames;  // oldest first
    std::size_t count = 0;
    std::uint64_t next = 0;  // number of the frame taken in next
  };
  [[nodiscard]] static const Held* frameOf(const Side& side, const std::string& file_name);
  static void dropOldest(Side& side, std::size_t frames);
  void releaseUpTo(Side& side, const std::string& file_name);

  std::array<Side, 2> sides_;
  std::size_t most_;
  std::uint64_t unused_ = 0;
};

// The log's inputs in order of position: new ones from the ring in shared memory, those that the ring has
// overwritten from the file. Inputs that neither has are skipped and counted, after a time in which the
// recorder may still write them.
class InputFeed {
 public:
  // `patience_ns`: time for the recorder to write inputs that the ring has overwritten.
  static constexpr std::int64_t kPatience_ns = 30'000'000'000;
  InputFeed(std::filesystem::path mission, const MapperDown& down, std::int64_t patience_ns = kPatience_ns);

  // Begins after the mark of checkpoint `number`, at `position`; 0, 0: at the log's beginning. False if the
  // file does not hold the mark.
  [[nodiscard]] bool begin(std::uint64_t number, std::uint64_t position);

  // The next input; false when there is none yet.
  [[nodiscard]] bool next(io::OnboardInput& input);
  // Of the input that next() gives.
  [[nodiscard]] std::uint64_t position() const { return position_; }
  // Logged decision about a pair, in the part read so far or after it.
  [[nodiscard]] std::optional<io::Decision> decisionOf(std::uint32_t pair) const;
  [[nodiscard]] std::uint64_t skipped() const { return skipped_; }
  // Part of skipped() that the log may have by now: the recorder took longer than the patience.
  [[nodiscard]] std::uint64_t passedOver() const { return passed_over_; }

 private:
  enum class OfFile : std::uint8_t { kGot, kMissing, kNotYet };
  [[nodiscard]] OfFile nextOfFile(io::OnboardInput& input);
  [[nodiscard]] bool giveUpWaiting();
  void note(const io::OnboardInput& input);

  std::filesystem::path mission_;
  const MapperDown& down_;
  std::int64_t patience_ns_;
  std::unique_ptr<io::LogInputReader> file_;
  std::map<std::uint32_t, io::Decision> decisions_;
  std::uint64_t position_ = 0, skipped_ = 0, passed_over_ = 0;
  std::int64_t waiting_since_ns_ = 0;  // monotonic; 0: not
};

}  // namespace fathom::onboard
