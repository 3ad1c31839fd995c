#include "recon/topside/work/progress.hpp"

#include <unistd.h>

#include <algorithm>
#include <cstdio>

namespace fathom::topside {
namespace {

constexpr std::size_t kBarWidth = 40;  // characters

}  // namespace

Progress::Progress(std::string stage, std::size_t steps)
    : stage_(std::move(stage)),
      steps_(std::max<std::size_t>(steps, 1)),
      terminal_(::isatty(STDERR_FILENO) == 1) {
  if (terminal_) show();
}

Progress::~Progress() {
  if (terminal_) std::fputc('\n', stderr);
}

void Progress::step() {
  ++done_;
  const std::size_t tenth = done_ * 10 / steps_;
  if (terminal_) {
    show();
  } else if (tenth > shown_tenth_) {
    std::fprintf(stderr, "%s: %zu of %zu\n", stage_.c_str(), done_, steps_);
  }
  shown_tenth_ = tenth;
}

void Progress::show() const {
  const std::size_t filled = std::min(kBarWidth, done_ * kBarWidth / steps_);
  std::fprintf(stderr, "\r%-10s [%s%s] %zu/%zu", stage_.c_str(), std::string(filled, '#').c_str(),
               std::string(kBarWidth - filled, ' ').c_str(), done_, steps_);
  std::fflush(stderr);
}

}  // namespace fathom::topside
