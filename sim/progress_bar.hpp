#pragma once

#include <unistd.h>

#include <cstddef>
#include <cstdio>
#include <string>

namespace fathom::sim {

// A bar that redraws itself on a terminal, a line every tenth elsewhere. `done` grows by one.
inline void showProgress(std::size_t done, std::size_t total) {
  if (::isatty(STDERR_FILENO) != 0) {
    constexpr std::size_t kWidth = 40;  // of the bar [characters]
    const std::size_t full = done * kWidth / total;
    std::fprintf(stderr, "\r[%s%s] %zu/%zu pairs%s", std::string(full, '#').c_str(),
                 std::string(kWidth - full, '.').c_str(), done, total, done == total ? "\n" : "");
  } else if (done * 10 / total != (done - 1) * 10 / total) {
    std::fprintf(stderr, "%zu of %zu pairs\n", done, total);
  }
}

}  // namespace fathom::sim
