#pragma once

#include <cstdint>
#include <sstream>
#include <string>
#include <vector>

namespace fathom::test {

// The lines of dive_recorder: what had been offered, and what was safe, at which time.
struct RecorderStatus {
  struct Line {
    std::int64_t time_ms = 0;
    std::uint64_t offered = 0, safe = 0;  // numbers behind the last input
  };
  std::vector<Line> lines;

  explicit RecorderStatus(const std::string& text) {
    std::istringstream in(text);
    std::string line;
    while (std::getline(in, line)) {
      // A line without its end was cut with the recorder.
      Line read;
      std::istringstream words(line);
      if (!in.eof() && words >> read.time_ms >> read.offered >> read.safe) lines.push_back(read);
    }
  }

  [[nodiscard]] std::uint64_t safe() const { return lines.empty() ? 0 : lines.back().safe; }
  [[nodiscard]] std::uint64_t offered() const { return lines.empty() ? 0 : lines.back().offered; }
  // What had been offered `age_ms` before the last line.
  [[nodiscard]] std::uint64_t offeredBefore(std::int64_t age_ms) const {
    std::uint64_t offered = 0;
    for (const Line& line : lines)
      if (line.time_ms <= lines.back().time_ms - age_ms) offered = line.offered;
    return offered;
  }
  // Age at the last line of the oldest input behind number `found`, at most: it was offered after the line
  // before; 0 when there is none [ms].
  [[nodiscard]] std::int64_t lostMs(std::uint64_t found) const {
    if (offered() <= found) return 0;
    std::int64_t there_ms = lines.front().time_ms;
    for (const Line& line : lines)
      if (line.offered <= found) there_ms = line.time_ms;
    return lines.back().time_ms - there_ms;
  }
};

}  // namespace fathom::test
