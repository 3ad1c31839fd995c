#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "firmware_if/log/log_messages.hpp"

namespace fathom::io {

// A connection to an LCM bus. liblcm receives on a thread of its own and keeps what waits in memory of its
// own; both are best effort and outside the program's pools. publish() may be called from several threads,
// everything else from one.
class LcmBus {
 public:
  // `url` as lcm_create() takes it: "udpm://239.255.76.67:7667?ttl=0" stays on this machine and "?ttl=1"
  // reaches the network beside it; "memq://" stays in this object. Throws InputError, with the command that
  // gives the machine a multicast route when that is what is missing.
  explicit LcmBus(const std::string& url);
  ~LcmBus();
  LcmBus(const LcmBus&) = delete;
  LcmBus& operator=(const LcmBus&) = delete;

  // False when the system refused it; counted.
  bool publish(const LogMessage& message) noexcept;
  [[nodiscard]] std::uint64_t refused() const noexcept;

  class Receiver {
   public:
    virtual ~Receiver() = default;
    virtual void message(std::string_view channel, std::span<const std::uint8_t> data) noexcept = 0;
  };
  // Channels that match the regular expression `channels` go to the receiver, which must outlive the bus. At
  // most `queue` messages wait for poll(), the newest are dropped beyond. Set-up only; throws InputError.
  void subscribe(const std::string& channels, int queue, Receiver& receiver);
  // Waits at most `timeout_ms` for a message, then hands over those that wait, at most `max_messages`.
  // Returns how many; -1 when the bus has failed.
  [[nodiscard]] int poll(int timeout_ms, int max_messages) noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::io
