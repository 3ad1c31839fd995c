#include "firmware_if/lcm_bus/lcm_bus.hpp"

#include <lcm/lcm.h>
#include <poll.h>

#include <atomic>

#include "realtime/kernel/input_error.hpp"

namespace fathom::io {
namespace {

void handOver(const lcm_recv_buf_t* received, const char* channel, void* receiver) {
  static_cast<LcmBus::Receiver*>(receiver)->message(
      channel, {static_cast<const std::uint8_t*>(received->data), received->data_size});
}

}  // namespace

struct LcmBus::Impl {
  std::string url;
  lcm_t* lcm = nullptr;
  int fd = -1;
  std::atomic<std::uint64_t> refused{0};
};

LcmBus::LcmBus(const std::string& url) : impl_(std::make_unique<Impl>()) {
  impl_->url = url;
  impl_->lcm = lcm_create(url.c_str());
  if (impl_->lcm == nullptr)
    throw InputError("LCM " + url, "",
                     "cannot be opened; give udpm://239.255.76.67:7667?ttl=0, and where the machine has no "
                     "network, run: ip route add 239.255.76.67/32 dev lo");
}

LcmBus::~LcmBus() {
  lcm_destroy(impl_->lcm);
}

bool LcmBus::publish(const LogMessage& message) noexcept {
  if (lcm_publish(impl_->lcm, message.channel.c_str(), message.data.data(),
                  static_cast<unsigned>(message.data.size())) == 0)
    return true;
  ++impl_->refused;
  return false;
}

std::uint64_t LcmBus::refused() const noexcept {
  return impl_->refused;
}

void LcmBus::subscribe(const std::string& channels, int queue, Receiver& receiver) {
  lcm_subscription_t* subscription = lcm_subscribe(impl_->lcm, channels.c_str(), handOver, &receiver);
  if (subscription == nullptr)
    throw InputError("LCM " + impl_->url, "",
                     "does not hear itself; look at the machine's routes and firewall");
  lcm_subscription_set_queue_capacity(subscription, queue);
  impl_->fd = lcm_get_fileno(impl_->lcm);
}

int LcmBus::poll(int timeout_ms, int max_messages) noexcept {
  pollfd bus = {impl_->fd, POLLIN, 0};
  int handled = 0;
  // liblcm's descriptor is readable while messages wait.
  while (handled < max_messages && ::poll(&bus, 1, handled == 0 ? timeout_ms : 0) == 1) {
    if ((bus.revents & POLLIN) == 0 || lcm_handle(impl_->lcm) != 0) return -1;
    ++handled;
  }
  return handled;
}

}  // namespace fathom::io
