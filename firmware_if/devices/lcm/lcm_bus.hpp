#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "firmware_if/mission/log/log_messages.hpp"

namespace fathom::io {

// A connection to an LCM bus. liblcm receives on a thread of its own and keeps waiting messages in its own
// memory; both are best effort and outside the program's pools. publish() and refused() may be called from
// several threads, everything else from one.
//
// A bus that cannot be joined now (no interface up, no multicast route) or that fails is joined by poll(),
// after 2, 4... 64 s, with its subscription; until then nothing comes and publish() refuses. A try may take
// some seconds: liblcm waits for a message of its own to come back.
class LcmBus {
 public:
  // `url` as lcm_create() takes it: "udpm://239.255.76.67:7667?ttl=0" stays on this machine and "?ttl=1"
  // reaches the network beside it; "memq://" stays in this object. Tries to join. Throws InputError for a url
  // that can never be joined.
  explicit LcmBus(const std::string& url, std::int64_t first_wait_ns = 2'000'000'000);
  ~LcmBus();
  LcmBus(const LcmBus&) = delete;
  LcmBus& operator=(const LcmBus&) = delete;

  // False when there is no bus or the system refused it; counted.
  bool publish(const LogMessage& message) noexcept;
  [[nodiscard]] std::uint64_t refused() const noexcept;

  class Receiver {
   public:
    virtual ~Receiver() = default;
    virtual void message(std::string_view channel, std::span<const std::uint8_t> data) noexcept = 0;
  };
  // Channels that match the regular expression `channels` go to the receiver, which must outlive the bus. At
  // most `queue` messages wait for poll(), the newest are dropped beyond. Once, at set-up.
  void subscribe(const std::string& channels, int queue, Receiver& receiver);
  // Waits at most `timeout_ms` for a message, then hands over those that wait, at most `max_messages`.
  // Returns how many; -1 when there is no bus.
  [[nodiscard]] int poll(int timeout_ms, int max_messages) noexcept;

  [[nodiscard]] bool isOpen() const noexcept;
  // Why it is not, with the command that gives the machine a multicast route; static storage.
  [[nodiscard]] const char* reason() const noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::io
