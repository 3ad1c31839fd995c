#include "sim/link/channel.hpp"

#include <arpa/inet.h>
#include <netdb.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <system_error>

#include "realtime/base/input_error.hpp"
#include "sim/scenario/key_range_check.hpp"

namespace fathom::sim {
namespace {

constexpr double kBitsPerByte = 8.0;
// Extra delay of an overtaken frame and of a duplicate (a surface echo), over the delay.
constexpr double kLateShare = 1.5;
// Least extra delay [s].
constexpr double kLeastLate = 0.05;

// A number in [0, 1) that depends on the generator's bits alone, unlike the standard library's distributions.
double uniform(std::mt19937_64& random) {
  return static_cast<double>(random() >> 11) * 0x1p-53;
}

constexpr int kLongestWaitMs = 200;  // between checks for signals and idleness

volatile std::sig_atomic_t stop_requested = 0;

void requestStop(int) {
  stop_requested = 1;
}

class Socket {
 public:
  explicit Socket(std::uint16_t port) : fd_(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0)) {
    if (fd_ < 0) throw std::system_error(errno, std::generic_category(), "UDP socket");
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_ANY);
    address.sin_port = htons(port);
    if (::bind(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
      const std::string reason = std::strerror(errno);
      ::close(fd_);
      throw InputError("--listen", std::to_string(port),
                       "this port cannot be used (" + reason + "); give a free one");
    }
  }
  ~Socket() { ::close(fd_); }
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;
  [[nodiscard]] int fd() const { return fd_; }

  // Receives one datagram; its size, 0 for none. The buffer is one byte longer than a frame, so that the
  // channel refuses datagrams that are too long.
  std::size_t receive(std::span<std::uint8_t> buffer, sockaddr_in& from) const {
    socklen_t length = sizeof from;
    const ssize_t size =
        ::recvfrom(fd_, buffer.data(), buffer.size(), 0, reinterpret_cast<sockaddr*>(&from), &length);
    return size > 0 ? static_cast<std::size_t>(size) : 0;
  }
  void send(std::span<const std::uint8_t> frame, const sockaddr_in& to) const {
    // While no receiver exists, frames are lost; that is no error.
    (void)::sendto(fd_, frame.data(), frame.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
  }

 private:
  int fd_;
};

sockaddr_in resolve(const std::string& host, std::uint16_t port) {
  addrinfo hints{};
  hints.ai_family = AF_INET;
  hints.ai_socktype = SOCK_DGRAM;
  addrinfo* found = nullptr;
  if (port == 0 || ::getaddrinfo(host.c_str(), nullptr, &hints, &found) != 0 || found == nullptr)
    throw InputError("--to", host + ":" + std::to_string(port),
                     "is no address that can be sent to; give HOST:PORT");
  sockaddr_in address{};
  std::memcpy(&address, found->ai_addr, sizeof address);
  ::freeaddrinfo(found);
  address.sin_port = htons(port);
  return address;
}

bool sameEnd(const sockaddr_in& a, const sockaddr_in& b) {
  return a.sin_addr.s_addr == b.sin_addr.s_addr && a.sin_port == b.sin_port;
}

double secondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

void report(const char* name, const AcousticChannel::Counters& c) {
  std::fprintf(
      stderr,
      "simulated acoustic channel, %s: %llu frames offered, %llu refused, %llu lost, %llu duplicated, "
      "%llu reordered, %llu corrupted, %llu collided, %llu delivered\n",
      name, static_cast<unsigned long long>(c.offered), static_cast<unsigned long long>(c.refused),
      static_cast<unsigned long long>(c.lost), static_cast<unsigned long long>(c.duplicated),
      static_cast<unsigned long long>(c.reordered), static_cast<unsigned long long>(c.corrupted),
      static_cast<unsigned long long>(c.collided), static_cast<unsigned long long>(c.delivered));
}

}  // namespace

void validate(const ChannelConfig& config) {
  const auto require = [](bool good, const char* what) { requireSetting(good, "channel", what); };
  for (double p : {config.loss, config.duplicate, config.reorder, config.corrupt})
    require(p >= 0 && p <= 1, "loss, duplicate, reorder and corrupt are probabilities, 0 to 1");
  require(config.mean_burst == 0 || (config.mean_burst >= 1 && config.mean_burst <= 1000),
          "mean_burst must be 0 (independent losses) or 1 to 1000");
  // The good state lasts one frame or more.
  require(config.mean_burst == 0 || config.loss < 1, "bursts need a loss below 1");
  require(config.mean_burst == 0 || config.loss <= config.mean_burst * (1 - config.loss),
          "so much loss needs longer bursts: mean_burst at least loss / (1 - loss)");
  require(config.delay_s >= 0 && config.delay_s <= 3600, "delay_s must be 0 to 3600");
  require(config.late_s >= 0 && config.late_s <= 3600, "late_s must be 0 to 3600");
  require(config.rate_bps >= 0 && config.rate_bps <= 1e9, "rate_bps must be 0 (no limit) to 1e9");
  require(config.preamble_s >= 0 && config.preamble_s <= 60, "preamble_s must be 0 to 60");
  require(config.queue_frames >= 1 && config.queue_frames <= 100000, "queue_frames must be 1 to 100000");
}

AcousticChannel::AcousticChannel(const ChannelConfig& config) : config_(config), random_(config.seed) {
  validate(config);
}

bool AcousticChannel::loses() {
  const double draw = uniform(random_);
  if (config_.mean_burst == 0) return draw < config_.loss;
  const double leave_bad = 1 / config_.mean_burst;
  // The chain's stationary share of the bad state is the loss.
  const double leave_good = config_.loss / (config_.mean_burst * (1 - config_.loss));
  bad_ = bad_ ? draw >= leave_bad : draw < leave_good;
  return bad_;
}

bool AcousticChannel::transmitting(double from_s, double to_s) const {
  return std::any_of(transmissions_.begin(), transmissions_.end(),
                     [&](const Transmission& t) { return t.begin_s < to_s && from_s < t.end_s; });
}

bool AcousticChannel::send(double now_s, std::span<const std::uint8_t> frame) {
  ++counters_.offered;
  std::erase_if(departures_, [&](double end_s) { return end_s <= now_s; });
  if (frame.empty() || frame.size() > FramePort::kMaxFrameBytes ||
      departures_.size() >= config_.queue_frames) {
    ++counters_.refused;
    return false;
  }
  double begin_s = now_s, sent_s = now_s;
  if (config_.rate_bps > 0) {
    begin_s = std::max(busy_until_s_, now_s);
    busy_until_s_ =
        begin_s + config_.preamble_s + kBitsPerByte * static_cast<double>(frame.size()) / config_.rate_bps;
    sent_s = busy_until_s_;
    departures_.push_back(sent_s);
    transmissions_.push_back({begin_s, sent_s});
    if (transmissions_.size() > kTransmissions) transmissions_.pop_front();
  }
  // Every frame draws the same count of numbers, so that its result is independent of the other frames.
  const bool lost = loses();
  const double duplicated = uniform(random_), reordered = uniform(random_), corrupted = uniform(random_);
  const std::uint64_t damage = random_();
  if (lost) {
    ++counters_.lost;
    return true;
  }
  std::vector<std::uint8_t> bytes(frame.begin(), frame.end());
  if (corrupted < config_.corrupt) {
    ++counters_.corrupted;
    // Damages up to four neighbouring bytes; the first always changes.
    const std::size_t first = damage % bytes.size();
    bytes[first] ^= static_cast<std::uint8_t>(1 + (damage >> 32) % 255);
    for (std::size_t i = first + 1; i < std::min(bytes.size(), first + 4); ++i)
      bytes[i] ^= static_cast<std::uint8_t>(damage >> (40 + 8 * (i - first - 1)));
  }
  const double late_s = std::max(kLeastLate, kLateShare * config_.delay_s);
  begin_s += config_.delay_s;
  double arrival_s = sent_s + config_.delay_s;
  if (duplicated < config_.duplicate) {
    ++counters_.duplicated;
    launch(begin_s + late_s, arrival_s + late_s, bytes);
  }
  if (reordered < config_.reorder) {
    ++counters_.reordered;
    const double overtaken_s = config_.late_s > 0 ? config_.late_s * reordered / config_.reorder : late_s;
    begin_s += overtaken_s;
    arrival_s += overtaken_s;
  }
  launch(begin_s, arrival_s, std::move(bytes));
  return true;
}

void AcousticChannel::launch(double begin_s, double arrival_s, std::vector<std::uint8_t> bytes) {
  in_transit_.push_back({begin_s, arrival_s, next_order_++, std::move(bytes)});
}

std::size_t AcousticChannel::receive(double now_s, std::span<std::uint8_t> buffer) {
  while (true) {
    const auto first =
        std::min_element(in_transit_.begin(), in_transit_.end(), [](const InTransit& a, const InTransit& b) {
          return a.arrival_s != b.arrival_s ? a.arrival_s < b.arrival_s : a.order < b.order;
        });
    if (first == in_transit_.end() || first->arrival_s > now_s || first->bytes.size() > buffer.size())
      return 0;
    const InTransit frame = std::move(*first);
    in_transit_.erase(first);
    if (reverse_ != nullptr && reverse_->transmitting(frame.begin_s, frame.arrival_s)) {
      ++counters_.collided;
      continue;
    }
    std::copy(frame.bytes.begin(), frame.bytes.end(), buffer.begin());
    ++counters_.delivered;
    return frame.bytes.size();
  }
}

double AcousticChannel::nextArrival() const {
  double next = -1;
  for (const InTransit& frame : in_transit_)
    if (next < 0 || frame.arrival_s < next) next = frame.arrival_s;
  return next;
}

ChannelPair::ChannelPair(const ChannelConfig& up, const ChannelConfig& down, bool half_duplex)
    : up_(up),
      down_([&] {
        ChannelConfig own = down;
        if (down.seed == up.seed) own.seed ^= AcousticChannel::kDownlinkStream;
        return own;
      }()),
      vehicle_(now_s_, up_, down_),
      ship_(now_s_, down_, up_) {
  if (!half_duplex) return;
  up_.loseWhileTransmitting(down_);
  down_.loseWhileTransmitting(up_);
}

int runChannelRelay(const ChannelRelayOptions& options) {
  const sockaddr_in ship = resolve(options.to_host, options.to_port);
  ChannelConfig down_config = options.down;
  down_config.seed ^= AcousticChannel::kDownlinkStream;
  AcousticChannel up(options.channel), down(down_config);
  if (options.half_duplex) {
    up.loseWhileTransmitting(down);
    down.loseWhileTransmitting(up);
  }
  const Socket socket(options.listen_port);
  stop_requested = 0;
  struct sigaction action {};
  action.sa_handler = requestStop;
  ::sigaction(SIGINT, &action, nullptr);
  ::sigaction(SIGTERM, &action, nullptr);

  const auto start = std::chrono::steady_clock::now();
  sockaddr_in vehicle{};
  bool vehicle_known = false;
  double last_frame_s = 0;
  std::array<std::uint8_t, FramePort::kMaxFrameBytes + 1> buffer{};
  while (stop_requested == 0) {
    double now_s = secondsSince(start);
    sockaddr_in from{};
    while (const std::size_t size = socket.receive(buffer, from)) {
      last_frame_s = now_s;
      const bool from_ship = sameEnd(from, ship);
      if (!from_ship) {
        vehicle = from;
        vehicle_known = true;
      }
      // The channel counts refused frames.
      (void)(from_ship ? down : up).send(now_s, std::span(buffer).first(size));
    }
    while (const std::size_t size = up.receive(now_s, buffer))
      socket.send(std::span(buffer).first(size), ship);
    while (const std::size_t size = down.receive(now_s, buffer))
      if (vehicle_known) socket.send(std::span(buffer).first(size), vehicle);

    double next_s = now_s + kLongestWaitMs * 1e-3;
    bool flying = false;
    for (const AcousticChannel* channel : {&up, &down}) {
      if (channel->nextArrival() < 0) continue;
      flying = true;
      next_s = std::min(next_s, channel->nextArrival());
    }
    if (options.idle_exit_s > 0 && !flying && now_s - last_frame_s >= options.idle_exit_s) break;
    now_s = secondsSince(start);
    pollfd waiting{socket.fd(), POLLIN, 0};
    // Rounded up: waking before the arrival would only spin.
    ::poll(&waiting, 1, std::clamp(static_cast<int>((next_s - now_s) * 1e3) + 1, 1, kLongestWaitMs));
  }
  report("up", up.counters());
  report("down", down.counters());
  return kExitSuccess;
}

}  // namespace fathom::sim
