#pragma once

#include <cstdint>
#include <filesystem>

namespace fathom::onboard {

// How long a thread that hangs is waited for until the whole program is started again for its sake: nothing
// else brings it back, and each time costs navigation a second. Twice as long each time in a dive.
class HungRestarts {
 public:
  // Counted in a file of that folder.
  explicit HungRestarts(const std::filesystem::path& state_folder);
  // Of a thread that may be silent for `limit_ns`.
  [[nodiscard]] std::int64_t patienceNs(std::int64_t limit_ns) const;
  // The program is about to end for it. False where that could not be written: it is not to end.
  [[nodiscard]] bool note();
  // A thread of this process waits for a disk that does not answer: the process could not end either.
  [[nodiscard]] static bool waitsForDisk();

 private:
  std::filesystem::path file_;
  int count_ = 0;
};

}  // namespace fathom::onboard
