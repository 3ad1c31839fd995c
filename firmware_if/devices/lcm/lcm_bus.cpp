#include "firmware_if/devices/lcm/lcm_bus.hpp"

#include <arpa/inet.h>
#include <lcm/lcm.h>
#include <poll.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <charconv>
#include <mutex>
#include <utility>

#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "realtime/kernel/time/clock.hpp"
#include "realtime/kernel/time/retry_wait.hpp"

namespace fathom::io {
namespace {

constexpr std::int64_t kLongestLcmWait_ns = 64 * kSecond_ns;
constexpr const char* kLcmNotJoined =
    "cannot be opened; give udpm://239.255.76.67:7667?ttl=0, and where the machine has no network, run: ip "
    "route add 239.255.76.67/32 dev lo";
constexpr const char* kNoLoopback =
    "does not receive its own messages; look at the machine's routes and firewall";

void handOver(const lcm_recv_buf_t* received, const char* channel, void* receiver) {
  static_cast<LcmBus::Receiver*>(receiver)->message(
      channel, {static_cast<const std::uint8_t*>(received->data), received->data_size});
}

// Whether the url names a provider of liblcm and, for udpm, a multicast address; its options are left to
// liblcm.
bool isLcmUrl(std::string_view url) {
  constexpr std::array<std::string_view, 5> kOthers = {"memq://", "file://", "tcpq://", "mpudpm://",
                                                       "udpm://"};
  const bool known = std::any_of(kOthers.begin(), kOthers.end(),
                                 [&](std::string_view provider) { return url.starts_with(provider); });
  if (!known || !url.starts_with("udpm://")) return known;
  const std::string network(url.substr(7, url.find('?') == url.npos ? url.npos : url.find('?') - 7));
  if (network.empty()) return true;  // liblcm's default
  const std::size_t colon = network.find(':');
  in_addr group = {};
  if (::inet_pton(AF_INET, network.substr(0, colon).c_str(), &group) != 1 ||
      !IN_MULTICAST(ntohl(group.s_addr)))
    return false;
  if (colon == network.npos) return true;
  int port = 0;
  const char* const end = network.data() + network.size();
  const auto parsed = std::from_chars(network.data() + colon + 1, end, port);
  return parsed.ec == std::errc{} && parsed.ptr == end && port > 0 && port <= 65535;
}

}  // namespace

struct LcmBus::Impl {
  Impl(const std::string& u, std::int64_t first_wait_ns) : url(u), wait(first_wait_ns, kLongestLcmWait_ns) {}

  // Joins, and listens where something is subscribed. On the polling thread.
  void open() noexcept {
    const std::int64_t now_ns = rt::RealClock().monotonicNs();
    if (!wait.due(now_ns)) return;
    lcm_t* joined = lcm_create(url.c_str());
    if (joined == nullptr) {
      reason = kLcmNotJoined;
    } else if (receiver != nullptr && !listen(joined)) {
      lcm_destroy(joined);
      joined = nullptr;
      reason = kNoLoopback;
    }
    // The try itself may have taken longer than the wait.
    if (joined == nullptr) return wait.failed(rt::RealClock().monotonicNs());
    wait.succeeded();
    reason = nullptr;
    const std::lock_guard<std::mutex> lock(mutex);
    lcm = joined;
  }
  bool listen(lcm_t* joined) noexcept {
    lcm_subscription_t* subscription = lcm_subscribe(joined, channels.c_str(), handOver, receiver);
    if (subscription == nullptr) return false;
    lcm_subscription_set_queue_capacity(subscription, queue);
    fd = lcm_get_fileno(joined);
    return true;
  }
  void close(const char* why) noexcept {
    lcm_t* left = nullptr;
    {
      const std::lock_guard<std::mutex> lock(mutex);
      std::swap(left, lcm);
    }
    if (left != nullptr) lcm_destroy(left);
    fd = -1;
    reason = why;
    wait.failed(rt::RealClock().monotonicNs());
  }

  std::string url, channels;
  int queue = 0;
  Receiver* receiver = nullptr;
  rt::RetryWait wait;
  const char* reason = nullptr;
  int fd = -1;  // nothing to read: nothing is subscribed
  // Of `lcm` as far as the publishing threads use it; only the polling thread changes it.
  std::mutex mutex;
  lcm_t* lcm = nullptr;
  std::atomic<std::uint64_t> refused{0};
};

LcmBus::LcmBus(const std::string& url, std::int64_t first_wait_ns)
    : impl_(std::make_unique<Impl>(url, first_wait_ns)) {
  if (!isLcmUrl(url)) throw InputError("LCM " + url, "", kLcmNotJoined);
  impl_->open();
}

LcmBus::~LcmBus() {
  if (impl_->lcm != nullptr) lcm_destroy(impl_->lcm);
}

bool LcmBus::publish(const LogMessage& message) noexcept {
  {
    const std::lock_guard<std::mutex> lock(impl_->mutex);
    if (impl_->lcm != nullptr && lcm_publish(impl_->lcm, message.channel.c_str(), message.data.data(),
                                             static_cast<unsigned>(message.data.size())) == 0)
      return true;
  }
  ++impl_->refused;
  return false;
}

std::uint64_t LcmBus::refused() const noexcept {
  return impl_->refused;
}

void LcmBus::subscribe(const std::string& channels, int queue, Receiver& receiver) {
  impl_->channels = channels;
  impl_->queue = queue;
  impl_->receiver = &receiver;
  if (impl_->lcm != nullptr && !impl_->listen(impl_->lcm)) impl_->close(kNoLoopback);
}

int LcmBus::poll(int timeout_ms, int max_messages) noexcept {
  if (impl_->lcm == nullptr) impl_->open();
  if (impl_->lcm == nullptr) {
    ::poll(nullptr, 0, timeout_ms);
    return -1;
  }
  pollfd bus = {impl_->fd, POLLIN, 0};
  int handled = 0;
  // liblcm's descriptor is readable while messages wait.
  while (handled < max_messages && ::poll(&bus, 1, handled == 0 ? timeout_ms : 0) == 1) {
    if ((bus.revents & POLLIN) == 0 || lcm_handle(impl_->lcm) != 0) {
      impl_->close("has failed");
      return -1;
    }
    ++handled;
  }
  return handled;
}

bool LcmBus::isOpen() const noexcept {
  return impl_->lcm != nullptr;
}

const char* LcmBus::reason() const noexcept {
  return impl_->reason == nullptr ? "" : impl_->reason;
}

}  // namespace fathom::io
