#include "realtime/onboard/restarting_run.hpp"

#include <stdexcept>
#include <string>
#include <utility>

#include "realtime/base/bytes/state_archive.hpp"

namespace fathom::onboard {
namespace {

const io::Mark* markOf(const io::OnboardInput& input, io::Mark::Kind kind) {
  const auto* mark = std::get_if<io::Mark>(&input.what);
  return mark != nullptr && mark->kind == kind ? mark : nullptr;
}

}  // namespace

RestartingRun::RestartingRun(Make make, const std::vector<io::OnboardInput>& inputs)
    : make_(std::move(make)), inputs_(inputs), run_(make_()) {
  for (std::size_t i = 0; i < inputs_.size(); ++i)
    if (const io::Mark* mark = markOf(inputs_[i], io::Mark::Kind::kRestart))
      if (mark->number != io::Mark::kEmptyMap) saved_[mark->number].last_use = i;
  if (saved_.count(0) > 0) save(saved_[0], 0);
}

void RestartingRun::save(Saved& to, std::size_t next) {
  to.next = next;
  constexpr std::size_t kFirst = std::size_t{16} << 20;
  to.state.resize(kFirst);
  for (;;) {
    rt::StateWriter writer(to.state);
    run_->save(writer);
    if (!writer.full()) {
      to.state.resize(writer.size());
      to.state.shrink_to_fit();
      return;
    }
    to.state.resize(writer.needed() + writer.needed() / 4);
  }
}

// A state may have been saved while the mapper did again what it had done before.
void RestartingRun::consume(std::size_t i) {
  run_->consume(inputs_[i]);
  const io::Mark* mark = markOf(inputs_[i], io::Mark::Kind::kCheckpoint);
  if (mark == nullptr) return;
  if (const auto wanted = saved_.find(mark->number); wanted != saved_.end()) save(wanted->second, i + 1);
}

void RestartingRun::restartEmpty() {
  run_ = make_();
  (void)run_->rollBackSlots(0);
  run_->system().setMapping(false);
  for (std::size_t i = 0; i < next_; ++i) consume(i);
  run_->system().setMapping(true);
}

void RestartingRun::restart(std::uint64_t number) {
  if (number == io::Mark::kEmptyMap) return restartEmpty();
  const auto from = saved_.find(number);
  if (from == saved_.end() || from->second.state.empty())
    throw std::runtime_error("the log restarts from checkpoint " + std::to_string(number) +
                             ", whose mark it does not hold");
  run_ = make_();
  rt::StateReader reader(from->second.state);
  if (!run_->rollBackSlots(number))
    throw std::runtime_error("the slots cannot go back to checkpoint " + std::to_string(number) +
                             " (disk full?); give slam.slot_folder on another disk");
  if (!run_->load(reader))
    throw std::runtime_error(std::string("a kept state does not load: ") + reader.failure());
  for (std::size_t i = from->second.next; i < next_; ++i) consume(i);
  if (from->second.last_use == next_) saved_.erase(from);
  forgetSlots();
}

void RestartingRun::forgetSlots() {
  const auto first = saved_.upper_bound(0);  // going back to 0 takes no memory
  run_->forgetSlots(first == saved_.end() ? UINT64_MAX : first->first);
}

bool RestartingRun::step() {
  if (next_ == inputs_.size()) return false;
  const io::OnboardInput& input = inputs_[next_];
  if (const io::Mark* mark = markOf(input, io::Mark::Kind::kRestart)) restart(mark->number);
  consume(next_++);
  if (markOf(input, io::Mark::Kind::kCheckpoint) != nullptr) forgetSlots();
  return true;
}

}  // namespace fathom::onboard
