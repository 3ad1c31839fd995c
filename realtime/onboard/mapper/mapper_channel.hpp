#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "firmware_if/devices/camera/camera_source.hpp"
#include "firmware_if/mission/log/onboard_input.hpp"
#include "realtime/kernel/frame_port.hpp"
#include "realtime/kernel/health/stage_times.hpp"
#include "realtime/kernel/rings/broadcast_ring.hpp"
#include "realtime/kernel/rings/shared_blocks.hpp"
#include "realtime/kernel/rings/spsc_ring.hpp"
#include "realtime/kernel/threads/overload_rule.hpp"
#include "realtime/kernel/time/vehicle_clock.hpp"
#include "realtime/onboard/checkpoint/checkpoint_file.hpp"
#include "recon/geometry/se3.hpp"
#include "telemetry/wire/uplink_messages.hpp"

namespace fathom::onboard {

// A modem frame to be sent. A received one is split into its link frames where it is received
// (io::ModemFrame), so that the many places that hold an input stay small.
struct OutgoingFrame {
  std::uint16_t size = 0;
  std::array<std::uint8_t, FramePort::kMaxFrameBytes> bytes{};
  [[nodiscard]] std::span<const std::uint8_t> data() const { return {bytes.data(), size}; }
};

// From the mapper to the modem's thread.
using ModemRing = rt::SpscRing<OutgoingFrame, 64>;

// Memory shared by the vehicle process and its mapper process, in two pieces: `MapperDown`, which the vehicle
// writes and the mapper can only read, so that no mapper damages navigation; `MapperUp`, which the mapper
// writes and the vehicle treats as untrusted bytes. Camera pools are further read-only pieces. All of it
// outlives the mapper: the next one continues with it.

// Inputs and frames by position; positions of inputs count from the beginning of the log (see
// firmware_if/mission/log), those of frames from the start of the vehicle process.
using InputBroadcast = rt::BroadcastRing<io::OnboardInput, 8192>;  // minutes: what is older is in the log

// An exposure in a camera's pool, with what makes an ImageView of it in any process.
struct LentFrame {
  io::CameraFrame frame;
  int width = 0, height = 0;  // [px]
  std::uint64_t stride = 0;   // [bytes]
  PixelFormat format = PixelFormat::kMono;
  int bits = 8;
};
using FrameBroadcast = rt::BroadcastRing<LentFrame, 64>;

struct PoolPlace {
  std::uint64_t bytes = 0, stride = 0, blocks = 0;
};

struct MapperDown {
  rt::VehicleClock::Setting clock;
  std::uint64_t configuration = 0, mission = 0;  // hashes: the mapper reads the same files
  std::array<PoolPlace, 2> pools;                // left, right
  InputBroadcast inputs;
  std::array<FrameBroadcast, 2> frames;
  // Safe on the disk: inputs before this position, and so many of the decisions from MapperUp.
  std::atomic<std::uint64_t> safe_position{0}, decisions_safe{0};
  // Numbers of checkpoints that the next mapper must not load, because the program died of them; 0: none.
  std::array<std::atomic<std::uint64_t>, 2> avoid{};
  // The next mapper begins at the present with an empty map: all other starts failed.
  std::atomic<bool> from_empty{false};
  // The first mapper of a dive that begins: no mark of a restart will come.
  std::atomic<bool> fresh{true};
  std::uint64_t most_held = 2;  // frames of a camera that a mapper may hold
};

enum class MapperPhase : std::uint32_t {
  kStarting = 0,  // pools are made
  kLoading,       // a checkpoint is read
  kCatchingUp,    // behind its restart's mark, or behind the present by more than it may lag
  kRunning,
  kFinishing,  // the end mark has come: final poses and map are made
  kEnded,      // the output is whole
  kNoMap,      // as kEnded, but no pair gave a map
  kRefused,    // it cannot work with what it found; its reason is on stderr
};
inline constexpr std::uint32_t kMapperPhases = 8;

// State of the map for reports.
struct MapState {
  std::int64_t utc_ns = 0;  // of the newest input consumed; 0: nothing yet
  SE3 T_nav_odom;
  bool anchored = false;
  telemetry::Status status;
  double mapped_area = 0;  // [m2]
  std::uint64_t pairs = 0, pairs_shed = 0, keyframes = 0, closures = 0, map_meshes_moved = 0;
  int map_tiles = 0, map_tiles_high_water = 0, map_layers = 0, map_layers_high_water = 0;
  std::uint64_t map_coarsened = 0, map_refused = 0;
  std::uint64_t link_frames = 0, link_bytes = 0, link_blocks_waiting = 0, link_frames_arrived = 0;
  rt::DegradationLevel level = rt::DegradationLevel::kFull;
  std::int64_t lag_ns = 0, highest_lag_ns = 0;  // behind the hard tier
  std::uint64_t frames_given_back = 0;          // without partner, or too late
  std::uint64_t inputs_skipped = 0;             // in neither memory nor disk
  std::uint64_t inputs_passed_over = 0;         // part of these that the log may have by now
  std::uint64_t rows_lost = 0;                  // of the output, refused by the disk
  MapState() noexcept = default;
  MapState(const MapState&) noexcept = default;
  MapState& operator=(const MapState&) noexcept = default;
};

// Measurements of the mapper for reports.
struct MapperFigures {
  static constexpr std::size_t kStages = 16;
  struct Stage {
    std::uint64_t count = 0, misses = 0;
    std::int64_t last_ns = 0, p50_ns = 0, p99_ns = 0, p999_ns = 0, max_ns = 0;
  };
  std::array<Stage, kStages> stages{};  // named by MapperTier::stageSpecs()
  rt::OverloadRule::Statistics overload;
  CheckpointWriter::Counters checkpoints;
  std::uint64_t planned = 0, resident = 0, resident_at_arming = 0;  // memory [bytes]
  std::uint64_t own =
      0;  // of the resident, what `planned` counts: neither files nor what it shares with the vehicle
  std::uint64_t heap_overflow = 0;  // beyond the reserve [bytes]
  std::uint64_t minor_faults = 0;   // since it was armed
  MapperFigures() noexcept = default;
  MapperFigures(const MapperFigures&) noexcept = default;
  MapperFigures& operator=(const MapperFigures&) noexcept = default;
};

// A decision about a pair, as it goes to the log.
struct PairDecision {
  std::int64_t utc_ns = 0;
  io::Decision decision;
};

// Decisions by pair, kept over a mapper's death, for the next one to repeat.
class DecisionTable {
 public:
  void set(const io::Decision& d) noexcept {
    const std::uint64_t packed = (std::uint64_t{d.pair_index} + 1) << 16U |
                                 static_cast<std::uint64_t>(d.level) << 1U | (d.dropped ? 1U : 0U);
    slots_[d.pair_index % kSlots].store(packed, std::memory_order_release);
  }
  [[nodiscard]] std::optional<io::Decision> of(std::uint32_t pair) const noexcept {
    const std::uint64_t packed = slots_[pair % kSlots].load(std::memory_order_acquire);
    if (packed >> 16U != std::uint64_t{pair} + 1) return std::nullopt;
    return io::Decision{pair, static_cast<std::uint8_t>(packed >> 1U & 0x7FFFU), (packed & 1U) != 0};
  }

 private:
  static constexpr std::size_t kSlots = 8192;  // over an hour of pairs: what is older is in the log
  std::array<std::atomic<std::uint64_t>, kSlots> slots_{};
};

struct MapperUp {
  // Called by the mapper; by the vehicle while there is none.
  void enter(MapperPhase now) noexcept { phase.store(static_cast<std::uint32_t>(now)); }
  [[nodiscard]] MapperPhase current() const noexcept {
    const std::uint32_t now = phase.load();
    return now < kMapperPhases ? static_cast<MapperPhase>(now) : MapperPhase::kRefused;
  }
  // The mapper's last report of the map. False, and `shown` untouched, if there is none or its values are
  // impossible.
  [[nodiscard]] bool readMap(MapState& shown) const noexcept;
  // Passes a decision to the log and to every mapper after this one.
  void decide(std::int64_t utc_ns, const io::Decision& decision) noexcept {
    decided.set(decision);
    if (decisions.push({utc_ns, decision})) decisions_made.fetch_add(1, std::memory_order_release);
  }

  std::atomic<std::uint32_t> phase{0};
  std::atomic<std::uint64_t> beats{0};         // grow while it gets on
  std::atomic<std::uint64_t> position{0};      // of the input consumed next
  std::atomic<std::uint64_t> loading{0};       // checkpoint that is being loaded; 0: none
  std::atomic<std::uint64_t> begun_with{0};    // checkpoint + 1, or 1: the log's beginning; 0: not known yet
  std::atomic<std::uint64_t> working_pair{0};  // that it is mapping, + 1; 0: none
  std::array<std::atomic<std::uint64_t>, 2> frame_floor{};  // frames before these are no longer needed
  std::atomic<std::uint64_t> decisions_made{0};             // pushed to `decisions`, by any mapper
  rt::SpscRing<PairDecision, 1024> decisions;
  ModemRing modem;
  DecisionTable decided;
  rt::SharedRecord<MapState> state;
  rt::SharedRecord<MapperFigures> figures;
  rt::BroadcastRing<rt::TimelineEvent, 4096> timeline;
};

// Both pieces, made by the vehicle or opened by the mapper.
class MapperChannel {
 public:
  // The vehicle's. Throws std::system_error.
  MapperChannel();
  // The mapper's, from the files that it was started with.
  MapperChannel(int down_file, int up_file);

  [[nodiscard]] MapperDown& down() noexcept { return *down_; }  // the vehicle only
  [[nodiscard]] const MapperDown& down() const noexcept { return *down_; }
  [[nodiscard]] MapperUp& up() noexcept { return *up_; }
  [[nodiscard]] const MapperUp& up() const noexcept { return *up_; }
  [[nodiscard]] int downFile() const noexcept { return down_memory_.file(); }
  [[nodiscard]] int upFile() const noexcept { return up_memory_.file(); }
  [[nodiscard]] std::size_t bytes() const noexcept { return down_memory_.bytes() + up_memory_.bytes(); }

 private:
  rt::SharedMemory down_memory_, up_memory_;
  MapperDown* down_;
  MapperUp* up_;
};

// Files of a mapper process by their numbers, as it is started.
inline constexpr int kMapperDownFile = 3, kMapperUpFile = 4, kMapperLeftPool = 5, kMapperRightPool = 6;

}  // namespace fathom::onboard
