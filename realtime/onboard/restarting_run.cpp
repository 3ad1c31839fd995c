#include "realtime/onboard/restarting_run.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>

#include "realtime/kernel/state_archive.hpp"

namespace fathom::onboard {
namespace {

const io::Mark* markOf(const io::OnboardInput& input, io::Mark::Kind kind) {
  const auto* mark = std::get_if<io::Mark>(&input.what);
  return mark != nullptr && mark->kind == kind ? mark : nullptr;
}

}  // namespace

RestartingRun::RestartingRun(Make make, const std::vector<io::OnboardInput>& inputs)
    : make_(std::move(make)), inputs_(inputs), run_(make_()) {
  restarts_ = std::any_of(inputs_.begin(), inputs_.end(), [](const io::OnboardInput& input) {
    return markOf(input, io::Mark::Kind::kRestart) != nullptr;
  });
  if (restarts_) save(begin_, 0, 0);
}

void RestartingRun::save(Saved& to, std::uint64_t number, std::size_t next) {
  to.number = number;
  to.next = next;
  constexpr std::size_t kFirst = std::size_t{16} << 20;
  to.state.resize(std::max(to.state.capacity(), kFirst));
  for (;;) {
    rt::StateWriter writer(to.state);
    run_->save(writer);
    if (!writer.full()) {
      to.state.resize(writer.size());
      return;
    }
    to.state.resize(writer.needed() + writer.needed() / 4);
  }
}

void RestartingRun::restart(std::uint64_t number) {
  const Saved* from = number == 0 ? &begin_ : nullptr;
  for (const Saved& saved : newest_)
    if (number != 0 && saved.number == number) from = &saved;
  if (from == nullptr)
    throw std::runtime_error("the log restarts from checkpoint " + std::to_string(number) +
                             ", whose mark it does not hold");
  run_ = make_();
  rt::StateReader reader(from->state);
  if (!run_->load(reader))
    throw std::runtime_error(std::string("a kept state does not load: ") + reader.failure());
  for (std::size_t i = from->next; i < next_; ++i) run_->consume(inputs_[i]);
}

bool RestartingRun::step() {
  if (next_ == inputs_.size()) return false;
  const io::OnboardInput& input = inputs_[next_];
  if (const io::Mark* mark = markOf(input, io::Mark::Kind::kRestart)) restart(mark->number);
  run_->consume(input);
  ++next_;
  if (const io::Mark* mark = markOf(input, io::Mark::Kind::kCheckpoint); mark != nullptr && restarts_)
    save(newest_[mark->number % newest_.size()], mark->number, next_);
  return true;
}

}  // namespace fathom::onboard
