#pragma once

#include <sys/types.h>

#include <string>

namespace fathom::sim {

// Runs a command of `ip` (iproute2), silently; false when it fails.
[[nodiscard]] bool ipCommand(const std::string& arguments);

// Puts this process and what it starts from now on into a network of its own, with a loopback that carries
// multicast (LCM); nobody else sees it, and it is gone with the last process in it, however that ends. Before
// any thread is started. Empty, or why it cannot be had.
[[nodiscard]] std::string enterOwnNetwork();

// A network cable (a veth pair, packets of 9000 bytes) from the bench's network to that of one child.
class Cable {
 public:
  explicit Cable(int number) : number_(number) {}
  [[nodiscard]] std::string nearName() const { return "camera" + std::to_string(number_); }
  [[nodiscard]] std::string nearAddress() const { return "10.77." + std::to_string(number_) + ".1"; }
  [[nodiscard]] std::string farAddress() const { return "10.77." + std::to_string(number_) + ".2"; }
  [[nodiscard]] bool connectNearEnd(pid_t child) const;  // in the bench, while the child waits in its network
  [[nodiscard]] bool connectFarEnd() const;              // then in the child

 private:
  int number_;
};

}  // namespace fathom::sim
