#include "recon/topside/work/run_progress.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "realtime/base/text.hpp"

namespace fathom::topside {
namespace {

constexpr double kFirstShare = 0.02;  // of the run's work before a time is foretold

}  // namespace

std::string durationText(double seconds) {
  const long whole = std::lround(seconds);
  if (whole >= 3600) return formatted("%ld h %02ld min", whole / 3600, whole / 60 % 60);
  if (whole >= 60) return formatted("%ld min %02ld s", whole / 60, whole % 60);
  return formatted("%ld s", whole);
}

RunProgress::RunProgress(double total_weight) : total_(std::max(total_weight, 1e-9)) {}

void RunProgress::begin(std::string stage, std::size_t steps, double weight) {
  const std::lock_guard lock(mutex_);
  stage_ = std::move(stage);
  steps_ = std::max<std::size_t>(steps, 1);
  done_ = 0;
  stage_weight_ = weight;
}

void RunProgress::step(bool was_there) {
  const std::lock_guard lock(mutex_);
  done_ = std::min(done_ + 1, steps_);
  if (was_there) spared_ += stage_weight_ / static_cast<double>(steps_);
  bar_.show(doneWeight() / total_,
            stage_ + ": " + std::to_string(done_) + " of " + std::to_string(steps_) + timeLeft());
}

void RunProgress::end() {
  const std::lock_guard lock(mutex_);
  before_ += stage_weight_;
  stage_weight_ = 0;
  done_ = steps_;
}

double RunProgress::doneWeight() const {
  return before_ + stage_weight_ * static_cast<double>(done_) / static_cast<double>(steps_);
}

std::string RunProgress::timeLeft() const {
  const double done = doneWeight();
  const double made = done - spared_;
  if (made < kFirstShare * total_) return {};
  const double elapsed = std::chrono::duration<double>(std::chrono::steady_clock::now() - begun_).count();
  return ", " + durationText(elapsed / made * std::max(total_ - done, 0.0)) + " left";
}

}  // namespace fathom::topside
