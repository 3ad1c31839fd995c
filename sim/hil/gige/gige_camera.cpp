#include "sim/hil/gige/gige_camera.hpp"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <future>
#include <optional>
#include <random>
#include <set>
#include <utility>
#include <vector>

#include "firmware_if/camera/pixel_unpack.hpp"
#include "firmware_if/image_file.hpp"
#include "realtime/kernel/clock.hpp"
#include "realtime/kernel/input_error.hpp"
#include "sim/hil/gige/gige_packets.hpp"
#include "sim/hil/gige/gige_registers.hpp"

namespace fathom::sim {
namespace {

using io::WireFormat;

constexpr std::uint16_t kControlPort = 3956;
constexpr std::int64_t kNsPerS = 1'000'000'000, kNsPerMs = 1'000'000, kNsPerUs = 1'000;
constexpr std::int64_t kIdleNs = 100 * kNsPerMs;       // longest sleep: the stop flag is looked at
constexpr std::int64_t kTaiAheadNs = 37 * kNsPerS;     // IEEE 1588 counts TAI
constexpr std::int64_t kNsPerTick = 8;                 // of the register of the tick frequency
constexpr std::uint32_t kFireTestPacket = 0x80000000;  // bits of the packet size register
constexpr std::uint32_t kPacketSizeMask = 0xffff;
constexpr std::uint32_t kLatch = 2, kResetStamp = 1;  // of the time stamp control register
constexpr std::size_t kLastFrames = 4;                // kept for resends
constexpr int kLastId = 65535;
constexpr std::size_t kDatagram = 16384;  // largest taken and given [bytes]
constexpr std::size_t kLeastPacket = 576;

// A file descriptor of a UDP socket.
class Socket {
 public:
  Socket() = default;
  Socket(std::uint32_t address, std::uint16_t port, const std::string& name) {
    fd_ = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    const int on = 1;
    ::setsockopt(fd_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    sockaddr_in own{};
    own.sin_family = AF_INET;
    own.sin_port = htons(port);
    own.sin_addr.s_addr = htonl(address);
    if (fd_ < 0 || ::bind(fd_, reinterpret_cast<const sockaddr*>(&own), sizeof own) != 0) {
      const int error = errno;
      close();
      throw InputError("--interface", name, std::string("cannot be served: ") + std::strerror(error));
    }
  }
  ~Socket() { close(); }
  Socket(Socket&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Socket& operator=(Socket&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  [[nodiscard]] int fd() const { return fd_; }

 private:
  void close() {
    if (fd_ >= 0) ::close(fd_);
    fd_ = -1;
  }
  int fd_ = -1;
};

struct Network {
  std::uint32_t address = 0, mask = 0xffffff00, broadcast = 0;
};

Network networkOf(const std::string& text) {
  in_addr wanted{};
  if (::inet_pton(AF_INET, text.c_str(), &wanted) != 1)
    throw InputError("--interface", text, "is no IPv4 address; give the address to serve on");
  Network network{.address = ntohl(wanted.s_addr)};
  ifaddrs* list = nullptr;
  if (::getifaddrs(&list) == 0) {
    for (const ifaddrs* i = list; i != nullptr; i = i->ifa_next) {
      if (i->ifa_addr == nullptr || i->ifa_addr->sa_family != AF_INET || i->ifa_netmask == nullptr) continue;
      if (reinterpret_cast<const sockaddr_in*>(i->ifa_addr)->sin_addr.s_addr == wanted.s_addr)
        network.mask = ntohl(reinterpret_cast<const sockaddr_in*>(i->ifa_netmask)->sin_addr.s_addr);
    }
    ::freeifaddrs(list);
  }
  network.broadcast = network.address | ~network.mask;
  return network;
}

class Server {
 public:
  Server(const GigeCameraOptions& options, const GigeSchedule& schedule);
  void run(const std::atomic<bool>& stop, const std::function<void()>& ready);

 private:
  void powerOn(std::int64_t now_ns);
  void powerOff();
  void listen();
  void control(const Socket& socket);
  void answer(const GvcpRequest& request, const sockaddr_in& from, const Socket& socket);
  void afterWrite(std::uint32_t address, std::int64_t now_ns);
  void resend(const GvcpRequest& request);
  void sendTestPacket();
  void expose(std::size_t n);
  [[nodiscard]] int firstId(std::size_t n) const;
  void sendFrame(const GvspFrame& frame, const std::set<std::uint32_t>& lost);
  bool sendPacket(const std::vector<std::uint8_t>& bytes, int flags = 0);
  void waitUntil(std::int64_t mono_ns);

  [[nodiscard]] std::int64_t mono() const { return clock_.monotonicNs(); }
  [[nodiscard]] std::int64_t dueNs(const GigeExposure& e) const {
    return start_mono_ns_ + static_cast<std::int64_t>((e.mission_s / options_.rate + e.late_s) * 1e9);
  }
  [[nodiscard]] std::int64_t missionNs(double mission_s) const {
    return start_mono_ns_ + static_cast<std::int64_t>(mission_s / options_.rate * 1e9);
  }
  [[nodiscard]] std::int64_t exposureNs() const {
    constexpr float kLongestUs = 1e7F;
    const float us = registers_->getFloat(gige::kExposure);
    return us > 0 ? static_cast<std::int64_t>(std::min(us, kLongestUs)) * kNsPerUs : 0;  // NaN: 0
  }
  // What the camera's clock shows.
  [[nodiscard]] std::int64_t deviceNs(std::int64_t mono_ns) const {
    if (registers_->get(gige::kPtpEnable) == 1) return mono_ns + utc_ahead_ns_ + kTaiAheadNs;
    const auto since = static_cast<double>(mono_ns - zero_mono_ns_);
    return zero_ns_ + static_cast<std::int64_t>(since * (1 + options_.clock_ppm * 1e-6));
  }
  [[nodiscard]] bool streaming() const {
    return controller_ && registers_->get(gige::kAcquisition) == 1 && registers_->get(gige::kStreamPort) != 0;
  }
  void load(std::size_t n);
  [[nodiscard]] std::vector<std::byte> wireImage(const io::ImageFile& image, const WireFormat& wire) const;

  GigeCameraOptions options_;
  const GigeSchedule& schedule_;
  rt::RealClock clock_;
  Network network_;
  int width_ = 0, height_ = 0;
  std::int64_t start_mono_ns_ = 0, utc_ahead_ns_ = 0;
  std::int64_t zero_mono_ns_ = 0, zero_ns_ = 0;  // of the camera's clock
  int next_id_ = 1;
  bool exposed_ = false;  // anything for a client yet

  std::optional<GigeRegisters> registers_;
  std::vector<Socket> sockets_;  // own address first; empty while it is away
  Socket stream_;
  struct Controller {
    std::uint32_t address = 0;
    std::uint16_t port = 0;
    bool operator==(const Controller&) const = default;
  };
  std::optional<Controller> controller_;
  std::int64_t heard_mono_ns_ = 0;

  struct Sent {
    GvspFrame frame;
    std::set<std::uint32_t> never;  // packets that stay lost
  };
  std::vector<Sent> sent_;
  std::future<io::ImageFile> next_image_;
  std::optional<std::size_t> loading_;
  std::mt19937_64 random_;
  std::ofstream log_;
};

Server::Server(const GigeCameraOptions& options, const GigeSchedule& schedule)
    : options_(options), schedule_(schedule), network_(networkOf(options.interface)), random_(options.seed) {
  // The first image that can be read tells the size of all.
  const io::ImageFile first =
      io::readImage(options_.images / schedule_.exposures.front().file, options_.format, options_.bits);
  width_ = first.view.width;
  height_ = first.view.height;
  utc_ahead_ns_ = clock_.utcNs() - mono();
  start_mono_ns_ = options_.start_utc_ns - utc_ahead_ns_;
  zero_ns_ = static_cast<std::int64_t>(options_.clock_offset_s * 1e9);
  next_id_ = options_.frame_id_start;
  if (options_.log.empty()) return;
  log_.open(options_.log);
  if (!log_) throw InputError(options_.log, "", "cannot be written");
  log_ << "number,mission_s,file,frame_id,device_ns,exposed_utc_ns,fate,packets,packets_lost,late_s\n";
}

void Server::powerOn(std::int64_t now_ns) {
  zero_mono_ns_ = now_ns;
  registers_.emplace(network_.address, network_.mask, options_.serial, width_, height_,
                     options_.format == PixelFormat::kBayerRggb, options_.bits);
  listen();
}

void Server::powerOff() {
  sockets_.clear();
  stream_ = Socket();
  controller_.reset();
  sent_.clear();
  registers_.reset();
}

void Server::listen() {
  sockets_.emplace_back(network_.address, kControlPort, options_.interface);
  // Searches come to everybody. What cannot be had here is no loss: the camera can be asked by its address.
  for (const std::uint32_t everybody : {network_.broadcast, INADDR_BROADCAST}) try {
      sockets_.emplace_back(everybody, kControlPort, options_.interface);
    } catch (const InputError&) {
    }
  stream_ = Socket(network_.address, 0, options_.interface);
  const int whole = IP_PMTUDISC_DO;  // a packet that does not fit the way is lost, as a test packet must be
  ::setsockopt(stream_.fd(), IPPROTO_IP, IP_MTU_DISCOVER, &whole, sizeof whole);
  const int buffer = 1 << 22;
  ::setsockopt(stream_.fd(), SOL_SOCKET, SO_SNDBUF, &buffer, sizeof buffer);
}

void Server::control(const Socket& socket) {
  std::array<std::uint8_t, kDatagram> datagram;
  for (;;) {
    sockaddr_in from{};
    socklen_t size = sizeof from;
    const ssize_t got = ::recvfrom(socket.fd(), datagram.data(), datagram.size(), 0,
                                   reinterpret_cast<sockaddr*>(&from), &size);
    if (got < 0) return;
    const auto request = parseGvcp({datagram.data(), static_cast<std::size_t>(got)});
    if (request) answer(*request, from, sockets_.front());
  }
}

void Server::answer(const GvcpRequest& request, const sockaddr_in& from, const Socket& socket) {
  const std::int64_t now = mono();
  const Controller asking{ntohl(from.sin_addr.s_addr), ntohs(from.sin_port)};
  if (controller_ == asking) heard_mono_ns_ = now;
  const bool may_write = !controller_ || controller_ == asking;
  const auto& in = request.payload;
  std::vector<std::uint8_t> out;
  GvcpStatus status = GvcpStatus::kSuccess;
  switch (static_cast<GvcpCommand>(request.command)) {
    case GvcpCommand::kDiscovery:
      out.resize(gige::kDiscoveryBytes);
      (void)registers_->read(0, out);
      break;
    case GvcpCommand::kReadRegisters:
      for (std::size_t i = 0; i + 4 <= in.size() && status == GvcpStatus::kSuccess; i += 4) {
        std::array<std::uint8_t, 4> value{};
        if (!registers_->read(bigEndian32(in, i), value)) status = GvcpStatus::kInvalidAddress;
        out.insert(out.end(), value.begin(), value.end());
      }
      break;
    case GvcpCommand::kWriteRegisters: {
      std::uint16_t written = 0;
      for (std::size_t i = 0; i + 8 <= in.size() && status == GvcpStatus::kSuccess; i += 8, ++written) {
        const std::uint32_t address = bigEndian32(in, i);
        if (!may_write)
          status = GvcpStatus::kAccessDenied;
        else if (!registers_->write(address, in.subspan(i + 4, 4)))
          status = GvcpStatus::kWriteProtect;
        else if (address == gige::kControlPrivilege && registers_->get(address) != 0)
          controller_ = asking, heard_mono_ns_ = now;
        if (status == GvcpStatus::kSuccess) afterWrite(address, now);
      }
      putBigEndian16(out, 0);
      putBigEndian16(out, written);
      break;
    }
    case GvcpCommand::kReadMemory: {
      const std::size_t count = in.size() < 8 ? 0 : bigEndian16(in, 6);
      const std::uint32_t address = in.size() < 8 ? 0 : bigEndian32(in, 0);
      putBigEndian32(out, address);
      out.resize(4 + count);
      if (count == 0 || !registers_->read(address, std::span(out).subspan(4)))
        status = GvcpStatus::kInvalidAddress;
      break;
    }
    case GvcpCommand::kWriteMemory:
      if (!may_write)
        status = GvcpStatus::kAccessDenied;
      else if (in.size() < 8 || !registers_->write(bigEndian32(in, 0), in.subspan(4)))
        status = GvcpStatus::kWriteProtect;
      else
        afterWrite(bigEndian32(in, 0), now);
      putBigEndian32(out, static_cast<std::uint32_t>(in.size()));
      break;
    case GvcpCommand::kPacketResend:
      resend(request);
      return;
    default:
      status = GvcpStatus::kNotImplemented;
  }
  if (!request.wants_answer) return;
  const std::vector<std::uint8_t> bytes = gvcpAnswer(request, status, out);
  ::sendto(socket.fd(), bytes.data(), bytes.size(), 0, reinterpret_cast<const sockaddr*>(&from), sizeof from);
}

void Server::afterWrite(std::uint32_t address, std::int64_t now_ns) {
  const std::uint32_t value = registers_->get(address);
  if (address == gige::kControlPrivilege && value == 0) {
    controller_.reset();
    registers_->set(gige::kAcquisition, 0);
  } else if (address == gige::kPacketSize && (value & kFireTestPacket) != 0) {
    registers_->set(address, value & ~kFireTestPacket);
    sendTestPacket();
  } else if (address == gige::kStampControl) {
    if ((value & kResetStamp) != 0) zero_mono_ns_ = now_ns, zero_ns_ = 0;
    if ((value & kLatch) != 0) {
      const auto ticks = static_cast<std::uint64_t>(deviceNs(now_ns) / kNsPerTick);
      registers_->set(gige::kStampHigh, static_cast<std::uint32_t>(ticks >> 32));
      registers_->set(gige::kStampLow, static_cast<std::uint32_t>(ticks));
    }
    registers_->set(address, 0);
  }
}

bool Server::sendPacket(const std::vector<std::uint8_t>& bytes, int flags) {
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<std::uint16_t>(registers_->get(gige::kStreamPort)));
  to.sin_addr.s_addr = htonl(registers_->get(gige::kStreamAddress));
  return ::sendto(stream_.fd(), bytes.data(), bytes.size(), flags, reinterpret_cast<const sockaddr*>(&to),
                  sizeof to) == static_cast<ssize_t>(bytes.size());
}

void Server::sendTestPacket() {
  const std::size_t size = registers_->get(gige::kPacketSize) & kPacketSizeMask;
  if (size < kLeastPacket || size > kDatagram) return;
  (void)sendPacket(std::vector<std::uint8_t>(size - kUdpOverhead));
}

// Packets `first` to `last` of a frame again, but for those that stay lost.
void Server::resend(const GvcpRequest& request) {
  constexpr std::uint32_t kPacketNumber = 0x00ffffff;
  if (request.payload.size() < 12) return;
  const std::uint16_t id = bigEndian16(request.payload, 2);
  const std::uint32_t first = bigEndian32(request.payload, 4) & kPacketNumber;
  const std::uint32_t last = bigEndian32(request.payload, 8) & kPacketNumber;
  std::vector<std::uint8_t> bytes;
  for (const Sent& sent : sent_)
    if (sent.frame.id == id)
      for (std::uint32_t n = first; n <= last && n < sent.frame.packets(); ++n) {
        if (sent.never.contains(n)) continue;
        sent.frame.packet(n, bytes);
        (void)sendPacket(bytes);
      }
}

// Reads an image beside the loop, so that a client is answered meanwhile.
void Server::load(std::size_t n) {
  loading_ = n;
  next_image_ =
      std::async(std::launch::async, [path = options_.images / schedule_.exposures[n].file,
                                      format = options_.format, bits = options_.bits, w = width_,
                                      h = height_] { return io::readImage(path, format, bits, w, h); });
}

// The part of the image that the registers ask for, as its packets have it.
std::vector<std::byte> Server::wireImage(const io::ImageFile& image, const WireFormat& wire) const {
  const std::size_t left = registers_->get(gige::kOffsetX), top = registers_->get(gige::kOffsetY);
  const std::size_t width = registers_->get(gige::kWidth), height = registers_->get(gige::kHeight);
  if (left + width > static_cast<std::size_t>(width_) || top + height > static_cast<std::size_t>(height_))
    return {};  // a camera that is set to nonsense sends nothing
  const std::size_t from_bytes = image.view.bits == 8 ? 1 : 2, to_bytes = wire.bits == 8 ? 1 : 2;
  std::vector<std::byte> pixels(width * height * to_bytes);
  for (std::size_t y = 0; y < height; ++y) {
    const auto* from =
        static_cast<const std::byte*>(image.view.data) + (y + top) * image.view.stride + left * from_bytes;
    std::byte* to = &pixels[y * width * to_bytes];
    if (from_bytes == to_bytes) {
      std::memcpy(to, from, width * to_bytes);
    } else {
      for (std::size_t x = 0; x < width; ++x) {
        std::uint16_t pixel;
        std::memcpy(&pixel, from + 2 * x, sizeof pixel);
        to[x] = static_cast<std::byte>(pixel >> (image.view.bits - 8));
      }
    }
  }
  std::vector<std::byte> bytes(io::wireBytes(wire.packing, width * height));
  (void)io::packPixels(wire.packing, width * height, pixels, bytes);
  return bytes;
}

void Server::sendFrame(const GvspFrame& frame, const std::set<std::uint32_t>& lost) {
  const std::int64_t gap_ns = static_cast<std::int64_t>(registers_->get(gige::kPacketDelay)) * kNsPerTick;
  std::vector<std::uint8_t> bytes;
  std::int64_t at = mono();
  for (std::uint32_t n = 0; n < frame.packets(); ++n) {
    // One that is lost took its time on the wire too.
    if (gap_ns > 0) clock_.sleepUntil(at += gap_ns);
    if (lost.contains(n)) continue;
    frame.packet(n, bytes);
    (void)sendPacket(bytes);
  }
}

// The id of the first exposure that a client has: such that the ids come to the number of the schedule's
// first wrap without a jump, which no camera makes, unless a restart comes between.
int Server::firstId(std::size_t n) const {
  for (std::size_t i = n; i < schedule_.exposures.size() && !schedule_.exposures[i].away; ++i) {
    const int wanted = schedule_.exposures[i].frame_id;
    if (wanted == 0) continue;
    const int ahead = static_cast<int>((i - n) % static_cast<std::size_t>(kLastId));
    return (wanted - 1 - ahead + kLastId) % kLastId + 1;
  }
  return next_id_;
}

void Server::expose(std::size_t n) {
  const GigeExposure& e = schedule_.exposures[n];
  const std::int64_t due = dueNs(e);
  const char* fate = "away";
  std::uint32_t packets = 0;
  std::set<std::uint32_t> lost;
  int id = 0;
  std::int64_t device_ns = 0;
  if (loading_ != n) load(n);
  const io::ImageFile image = next_image_.get();
  if (registers_ && !streaming()) fate = "idle";
  if (registers_ && streaming()) {
    if (!exposed_) next_id_ = firstId(n);
    exposed_ = true;
    id = e.frame_id != 0 ? e.frame_id : next_id_;
    next_id_ = id % kLastId + 1;  // 65535 is followed by 1
    device_ns = deviceNs(due);
    fate = "lost";
    GvspFrame frame;
    frame.id = static_cast<std::uint16_t>(id);
    frame.ticks = static_cast<std::uint64_t>(device_ns / kNsPerTick);
    frame.pixel_format = registers_->get(gige::kPixelFormat);
    const std::size_t packet_size = std::clamp<std::size_t>(
        registers_->get(gige::kPacketSize) & kPacketSizeMask, kLeastPacket, kDatagram);
    frame.data_bytes = packet_size - kGvspOverhead;
    const auto formats = io::wireFormats();
    const auto wire = std::find_if(formats.begin(), formats.end(),
                                   [&](const WireFormat& f) { return f.code == frame.pixel_format; });
    if (wire != formats.end()) frame.image = wireImage(image, *wire);
    frame.width = registers_->get(gige::kWidth);
    frame.height = registers_->get(gige::kHeight);
    packets = frame.packets();
    if (!e.lost && !frame.image.empty()) {
      fate = "sent";
      std::uniform_int_distribution<std::uint32_t> any(0, packets - 1);
      while (lost.size() < std::min<std::size_t>(static_cast<std::size_t>(e.lost_packets), packets))
        lost.insert(any(random_));
      sendFrame(frame, lost);
      if (sent_.size() == kLastFrames) sent_.erase(sent_.begin());
      sent_.push_back({std::move(frame), e.resend ? std::set<std::uint32_t>{} : lost});
    }
  }
  if (n + 1 < schedule_.exposures.size()) load(n + 1);
  if (!log_.is_open()) return;
  log_ << n << ',' << e.mission_s << ',' << e.file << ',' << id << ',' << device_ns << ','
       << due + utc_ahead_ns_ << ',' << fate << ',' << packets << ',' << lost.size() << ',' << e.late_s
       << '\n';
  log_.flush();
}

// Serves clients until then, or a little: at most kIdleNs.
void Server::waitUntil(std::int64_t mono_ns) {
  const std::int64_t wait = std::clamp<std::int64_t>(mono_ns - mono(), 0, kIdleNs);
  std::vector<pollfd> fds;
  for (const Socket& socket : sockets_) fds.push_back({socket.fd(), POLLIN, 0});
  const timespec timeout{wait / kNsPerS, wait % kNsPerS};
  if (::ppoll(fds.data(), fds.size(), &timeout, nullptr) <= 0) return;
  for (std::size_t i = 0; i < fds.size(); ++i)
    if ((fds[i].revents & POLLIN) != 0) control(sockets_[i]);
}

void Server::run(const std::atomic<bool>& stop, const std::function<void()>& ready) {
  ::prctl(PR_SET_TIMERSLACK, 1);
  powerOn(mono());
  ready();
  load(0);
  std::size_t next = 0, reboot = 0;
  while (!stop.load() && (next < schedule_.exposures.size() || !options_.exit_when_done)) {
    const std::int64_t now = mono();
    if (reboot < schedule_.reboots.size()) {
      const GigeReboot& r = schedule_.reboots[reboot];
      if (registers_ && now >= missionNs(r.at_s)) powerOff();
      if (!registers_ && now >= missionNs(r.at_s + r.for_s)) {
        zero_ns_ = 0;
        next_id_ = 1;
        powerOn(now);
        ++reboot;
      }
    }
    if (controller_ && now - heard_mono_ns_ > registers_->get(gige::kHeartbeatTimeout) * kNsPerMs) {
      registers_->set(gige::kControlPrivilege, 0);
      afterWrite(gige::kControlPrivilege, now);
    }
    std::int64_t until = now + kIdleNs;
    if (reboot < schedule_.reboots.size()) {
      const GigeReboot& r = schedule_.reboots[reboot];
      until = std::min(until, missionNs(registers_ ? r.at_s : r.at_s + r.for_s));
    }
    if (next < schedule_.exposures.size()) {
      const std::int64_t send = dueNs(schedule_.exposures[next]) + (registers_ ? exposureNs() : 0);
      if (now >= send) {
        expose(next++);
        continue;
      }
      until = std::min(until, send);
    }
    waitUntil(until);
  }
}

}  // namespace

void serveGigeCamera(const GigeCameraOptions& options, const GigeSchedule& schedule,
                     const std::atomic<bool>& stop, const std::function<void()>& ready) {
  Server(options, schedule).run(stop, ready);
}

}  // namespace fathom::sim
