#include <algorithm>
#include <filesystem>

#include "realtime/kernel/state_archive.hpp"
#include "realtime/onboard/live/live_system.hpp"

// How a live run begins, and goes on where an earlier one was cut off.
namespace fathom::onboard {

std::unique_ptr<MissionRun> LiveSystem::makeRun() {
  MissionRun::Setup setup;
  setup.config = setup_.config;
  setup.mission = setup_.mission;
  setup.rig = setup_.rig;
  setup.pairs.images = [this](const std::string& name, CameraSide side) { return pixels(name, side); };
  setup.slots = {slots_.features.get(), slots_.meshes.get()};
  setup.link.modem = &modem_port_;
  return std::make_unique<MissionRun>(std::move(setup), *output_);
}

void LiveSystem::resume() {
  resume_said_ = resume_.said;
  next_checkpoint_ = resume_.newest_number + 1;
  if (!resume_.any()) return;
  resumed_ = true;
  away_since_ns_ = resume_.last_ns;
  if (resume_.checkpoint) {
    rt::StateReader for_run(resume_.checkpoint->state), for_hard(resume_.checkpoint->state);
    if (!run_->rollBackSlots(resume_.number()))
      beginFromTheLog("its slots were not kept");
    else if (!run_->load(for_run) || !for_hard(hard_.nav()))
      beginFromTheLog(for_run.failure());
  }
  for (const io::OnboardInput& input : resume_.tail) hard_.follow(input);
  hard_.sequencer().startAfter(resume_.last_ns);
  resumed_from_ = resume_.number();
  (void)hard_.mark({io::Mark::Kind::kRestart, resumed_from_});
}

std::vector<std::filesystem::path> LiveSystem::checkpointNeeds() const {
  std::vector<std::filesystem::path> files = output_->files();
  for (const SlotFile* slots : {slots_.features.get(), slots_.meshes.get()})
    if (slots != nullptr) files.insert(files.end(), {slots->path(), slots->journalPath()});
  return files;
}

// A state that is ahead of the log would be of no use, and one whose decisions the log lacks would not be
// what a replay makes of it. Whatever was offered before the state was saved is on the disk when the recorder
// has begun a sync since then and ended it: of two, the second at the latest.
void LiveSystem::writeCheckpoint() {
  constexpr std::uint64_t kSyncsBetween = 2;
  if (!checkpoints_->waiting()) return;
  const std::uint64_t syncs = recorder_.counters().syncs;
  if (!syncs_then_) syncs_then_ = syncs;
  if (syncs < *syncs_then_ + kSyncsBetween) return;
  syncs_then_.reset();
  (void)checkpoints_->work();
}

// A checkpoint whose checksums are right, but which does not load, is of another program, or the files beside
// it are not those that it was saved with. Then the log is all there is.
void LiveSystem::beginFromTheLog(const std::string& why) {
  const std::string file = checkpoint_files_.file(resume_.number()).string();
  checkpoint_files_.remove();
  resume_ = readResume(setup_.folder, checkpoint_files_, names_);
  resume_said_.push_back(file + ": cannot be used (" + why + "); all is done again from the log");
  next_checkpoint_ = resume_.newest_number + 1;
  run_.reset();
  output_.reset();
  output_ = makeOutput(setup_, false);
  slots_ = {};
  slots_ = makeSlots(setup_, false);
  run_ = makeRun();
  hard_.nav() = NavFeed(navCoreConfig(setup_.config, setup_.mission));
}

std::optional<ImageView> LiveSystem::pixels(const std::string& file_name, CameraSide side) {
  const auto held = frames_.find(file_name, side);
  return held || !resumed_ ? held : recorded_source_.images(file_name, side);
}

bool LiveSystem::hasPixels(const std::string& file_name, CameraSide side) {
  if (frames_.find(file_name, side)) return true;
  return resumed_ && std::filesystem::exists(io::MissionPaths(setup_.folder).images() / file_name);
}

LiveSystem::~LiveSystem() {
  if (stopped_) return;
  stop_devices_ = stop_hard_ = stop_soft_ = stop_modem_ = stop_recorder_ = true;
  go_ = true;
  threads_.joinAllBut({});
}

}  // namespace fathom::onboard
