#include "recon/topside/work/run_progress.hpp"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "realtime/kernel/text.hpp"

namespace fathom::topside {
namespace {

constexpr double kBarWidth = 30;      // characters
constexpr double kLines = 20;         // a run, elsewhere
constexpr double kFirstShare = 0.02;  // of the run's work before a time is foretold

}  // namespace

RunProgress::RunProgress(double total_weight)
    : total_(std::max(total_weight, 1e-9)), terminal_(::isatty(STDERR_FILENO) == 1) {}

RunProgress::~RunProgress() {
  if (terminal_) std::fputc('\n', stderr);
}

void RunProgress::begin(std::string stage, std::size_t steps, double weight) {
  const std::lock_guard lock(mutex_);
  stage_ = std::move(stage);
  steps_ = std::max<std::size_t>(steps, 1);
  done_ = 0;
  stage_weight_ = weight;
  if (terminal_) show();
}

void RunProgress::step(bool was_there) {
  const std::lock_guard lock(mutex_);
  done_ = std::min(done_ + 1, steps_);
  if (was_there) spared_ += stage_weight_ / static_cast<double>(steps_);
  show();
}

void RunProgress::end() {
  const std::lock_guard lock(mutex_);
  before_ += stage_weight_;
  stage_weight_ = 0;
  done_ = steps_;
}

std::string RunProgress::timeLeft() const {
  const double done = before_ + stage_weight_ * static_cast<double>(done_) /
                                    static_cast<double>(std::max<std::size_t>(steps_, 1));
  const double made = done - spared_;
  if (made < kFirstShare * total_) return {};
  const double elapsed = std::chrono::duration<double>(std::chrono::steady_clock::now() - begun_).count();
  const long left = std::lround(elapsed / made * std::max(total_ - done, 0.0));
  if (left >= 3600) return formatted(", %ld h %02ld min left", left / 3600, left / 60 % 60);
  if (left >= 60) return formatted(", %ld min %02ld s left", left / 60, left % 60);
  return formatted(", %ld s left", left);
}

void RunProgress::show() {
  const double share = std::min(
      1.0, (before_ + stage_weight_ * static_cast<double>(done_) / static_cast<double>(steps_)) / total_);
  const int line = static_cast<int>(share * kLines);
  if (terminal_) {
    const auto filled = static_cast<std::size_t>(share * kBarWidth);
    std::fprintf(stderr, "\r\033[K%3.0f %% [%s%s] %s %zu/%zu%s", 100 * share,
                 std::string(filled, '#').c_str(),
                 std::string(static_cast<std::size_t>(kBarWidth) - filled, ' ').c_str(), stage_.c_str(),
                 done_, steps_, timeLeft().c_str());
    std::fflush(stderr);
  } else if (line > shown_) {
    std::fprintf(stderr, "%3.0f %% %s: %zu of %zu%s\n", 100 * share, stage_.c_str(), done_, steps_,
                 timeLeft().c_str());
  }
  shown_ = line;
}

}  // namespace fathom::topside
