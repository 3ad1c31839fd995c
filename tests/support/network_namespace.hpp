#pragma once

#include <utility>

#include "sim/hil/bench/child_process.hpp"

namespace fathom::test {

// Puts this thread, and the threads and processes that it starts from now on, into a network of its own that
// nobody else sees and that is gone when they are. Call it before any thread is started. Empty, or why it
// cannot be had: say so with GTEST_SKIP.
[[nodiscard]] inline std::string ownNetwork() {
  return sim::enterOwnNetwork();
}

// A program in a network of its own, joined to ours by cable `n`. Ended at destruction, with its network.
class NamespacedProcess {
 public:
  static std::string linkName(int n) { return sim::Cable(n).nearName(); }
  static std::string deviceAddress(int n) { return sim::Cable(n).farAddress(); }

  // Starts argv[0] with these arguments once the cable is there; its output goes to the file `output`.
  NamespacedProcess(int n, std::vector<std::string> argv, const std::string& output = "/dev/null")
      : link_("link set " + linkName(n)), process_({std::move(argv), {}, output, sim::Cable(n)}) {}

  // Pulls the cable, or puts it back.
  void unplug() const { (void)sim::ipCommand(link_ + " down"); }
  void plug() const { (void)sim::ipCommand(link_ + " up"); }

 private:
  std::string link_;
  sim::ChildProcess process_;
};

}  // namespace fathom::test
