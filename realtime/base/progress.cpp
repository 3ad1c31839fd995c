#include "realtime/base/progress.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>

namespace fathom::rt {
namespace {

constexpr double kBarWidth = 30;  // characters
constexpr double kLines = 20;     // elsewhere

}  // namespace

ProgressBar::ProgressBar() : terminal_(::isatty(STDERR_FILENO) == 1) {}

ProgressBar::~ProgressBar() {
  if (!drawn_.empty()) std::fputc('\n', stderr);
}

void ProgressBar::show(double share, const std::string& text) {
  share = std::clamp(share, 0.0, 1.0);
  const int part = static_cast<int>(share * kLines);
  if (!terminal_ && part <= shown_) return;
  shown_ = part;
  std::array<char, 8> percent{};
  std::snprintf(percent.data(), percent.size(), "%3.0f %% ", 100 * share);
  std::string line = percent.data();
  if (!terminal_) {
    std::fprintf(stderr, "%s%s\n", line.c_str(), text.c_str());
    return;
  }
  const auto full = static_cast<std::size_t>(share * kBarWidth);
  line += '[' + std::string(full, '#') + std::string(static_cast<std::size_t>(kBarWidth) - full, ' ') + "] ";
  line += text;
  if (line == drawn_) return;
  drawn_ = line;
  std::fprintf(stderr, "\r\033[K%s", line.c_str());
  std::fflush(stderr);
}

void ProgressBar::show(std::size_t done, std::size_t steps, const std::string& what) {
  show(static_cast<double>(done) / static_cast<double>(std::max<std::size_t>(steps, 1)),
       what + ": " + std::to_string(done) + " of " + std::to_string(steps));
}

}  // namespace fathom::rt
