#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "realtime/kernel/memory/heap_reserve.hpp"
#include "realtime/kernel/memory/memory_budget.hpp"
#include "realtime/onboard/checkpoint/checkpoint_file.hpp"
#include "realtime/onboard/mapper/mapper_channel.hpp"
#include "realtime/onboard/mapper/mapper_tier.hpp"
#include "realtime/onboard/recorded_pairs.hpp"
#include "realtime/onboard/slots/slot_file.hpp"

namespace fathom::onboard {

// Everything of the mapper process that maps: output, slots, the run with its cores, and saved states.
class MapperRun {
 public:
  struct Setup {
    std::filesystem::path folder;  // of the mission
    OnboardConfig config;
    io::MissionConfig mission;
    StereoRig rig;
    bool plan_only = false;  // its memory is all that is asked for: no room is taken on the disk
  };
  // Makes every pool. Files of an earlier mapper are kept where a state may need them; unusable ones are
  // reported on stderr. Throws InputError, std::runtime_error.
  MapperRun(Setup setup, MapperChannel& channel, rt::Clock& clock);
  MapperRun(const MapperRun&) = delete;
  MapperRun& operator=(const MapperRun&) = delete;

  // From now on its figures include its memory: armed, with this reserve.
  void measure(const rt::HeapReserve& heap);
  // Reports its memory plan and resident set to the vehicle process.
  void reportMemory();
  // Loads the newest usable state, or begins at the log's beginning; reports on stderr what was passed over.
  void begin();
  // Follows the log until `stop` or its end mark.
  void follow();
  // Final poses and map into onboard/; false when no pair gave a map.
  [[nodiscard]] bool finish();
  // Best effort: writes the state that waits, once the disk holds the log so far.
  void writeCheckpoint();

  [[nodiscard]] const rt::MemoryBudget& budget() const { return budget_; }
  [[nodiscard]] const OnboardConfig& config() const { return setup_.config; }

 private:
  void make(bool reopen);
  [[nodiscard]] std::unique_ptr<SlotStore> slots(const char* name, bool reopen, int slots,
                                                 std::size_t slot_bytes);
  [[nodiscard]] bool load(const CheckpointHead& head);
  [[noreturn]] void giveUpStates();
  void planMemory();
  void addMemory(MapperFigures& figures);
  void say(const std::string& line) const;
  // The disk refused data that output or map lacks now: this run's state differs from what the log gives.
  [[nodiscard]] bool lossy() const { return slots_refused_ || output_->lost(); }
  [[nodiscard]] std::optional<ImageView> pixels(const std::string& file_name, CameraSide side);
  [[nodiscard]] bool hasPixels(const std::string& file_name, CameraSide side);

  Setup setup_;
  MapperChannel& channel_;
  rt::Clock& clock_;
  rt::MemoryBudget budget_;
  CheckpointFiles files_;
  RingFramePort modem_;
  HeldFrames frames_;
  InputFeed feed_;
  RecordedPairs recorded_;
  OnboardSystem::PairSource recorded_source_;
  std::vector<CheckpointHead> heads_;  // of saved states that may be begun with, the newest first
  std::unique_ptr<OnboardOutput> output_;
  std::unique_ptr<SlotStore> features_, meshes_;
  std::vector<std::filesystem::path> slot_paths_;
  bool slots_refused_ = false;
  std::unique_ptr<MissionRun> run_;
  std::unique_ptr<CheckpointWriter> checkpoints_;
  std::unique_ptr<MapperTier> tier_;
  std::int64_t begun_ns_;
  const rt::HeapReserve* heap_ = nullptr;
  std::size_t resident_at_arming_ = 0;
  std::uint64_t faults_at_arming_ = 0;
  rt::ProcessMemory process_;
};

// The mapper process, a child of the vehicle process, which starts it with the files of mapper_channel.hpp
// open and kills it when it makes no progress. It reads the same mission, calibration and configuration,
// loads the newest saved state that loads (else the older one, else it begins at the log's beginning),
// follows the log to its end mark, and writes onboard/. It dies with its parent; the vehicle survives it.
// Exit statuses are those of a tool.
struct MapperOptions {
  std::filesystem::path folder;
  std::optional<std::filesystem::path> config;
  bool soft = false;
  bool print_budget = false;  // makes its pools, shows them and ends
};
int runMapper(const MapperOptions& options);

}  // namespace fathom::onboard
