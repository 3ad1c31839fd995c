#include "sim/hil/bench/bench_network.hpp"

#include <sched.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>

namespace fathom::sim {

bool ipCommand(const std::string& arguments) {
  return std::system(("ip " + arguments + " >/dev/null 2>&1").c_str()) == 0;
}

std::string enterOwnNetwork() {
  if (std::system("ip -V >/dev/null 2>&1") != 0) return "there is no `ip` command: install iproute2";
  if (::unshare(CLONE_NEWNET) != 0)
    return std::string("no network namespace (") + std::strerror(errno) +
           "): run as root, or with CAP_SYS_ADMIN";
  if (!ipCommand("link set lo up multicast on") || !ipCommand("route add 224.0.0.0/4 dev lo"))
    return "the loopback of a new network namespace cannot be set up";
  return "";
}

bool Cable::connectNearEnd(pid_t child) const {
  return ipCommand("link add " + nearName() + " mtu 9000 type veth peer name eth0 mtu 9000 netns " +
                   std::to_string(child)) &&
         ipCommand("addr add " + nearAddress() + "/24 broadcast + dev " + nearName()) &&
         ipCommand("link set " + nearName() + " up");
}

bool Cable::connectFarEnd() const {
  return ipCommand("link set lo up") && ipCommand("addr add " + farAddress() + "/24 broadcast + dev eth0") &&
         ipCommand("link set eth0 up");
}

}  // namespace fathom::sim
