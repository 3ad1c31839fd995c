#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

namespace fathom::bench {

// A program in a process group of its own, which ends with this object. Started without a fork: that would
// write-protect this process's pages, and its real-time threads would fault on each.
class ChildProcess {
 public:
  // Throws std::system_error when it cannot be started. `output`: what it prints goes into this file; empty:
  // it is thrown away.
  ChildProcess(const std::vector<std::string>& arguments, const std::string& output);
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  // Waits for it to end; its exit status, or -1 when a signal ended it.
  int wait();

 private:
  pid_t id_ = -1;
};

}  // namespace fathom::bench
