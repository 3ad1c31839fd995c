#pragma once

#include <cstdint>
#include <string>

#include "sim/link/channel.hpp"

namespace fathom::sim {

struct ChannelRelayOptions {
  std::uint16_t listen_port = 0;  // vehicle's frames arrive here (UDP, loopback and every other interface)
  std::string to_host;
  std::uint16_t to_port = 0;
  double idle_exit_s = 0;    // ends after this long without a frame; 0: only on SIGINT or SIGTERM
  ChannelConfig channel;     // from the vehicle to the ship
  ChannelConfig down;        // from the ship to the vehicle
  bool half_duplex = false;  // a modem receives nothing while it transmits
};

// Relays UDP datagrams (a datagram is a frame) from listen_port to to_host:to_port through a simulated
// acoustic channel, and datagrams that come back from there to the last sender, through a second one. Prints
// the counters on stderr at the end. Throws InputError for an address or port that cannot be used. Returns
// the exit code.
int runChannelRelay(const ChannelRelayOptions& options);

}  // namespace fathom::sim
