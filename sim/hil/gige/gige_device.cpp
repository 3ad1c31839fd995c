#include "sim/hil/gige/gige_device.hpp"

#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <utility>

#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"

namespace fathom::sim {
namespace {

constexpr std::uint16_t kControlPort = 3956;
constexpr std::int64_t kLongestWaitNs = 100 * kMillisecond_ns;
constexpr std::int64_t kTaiAheadNs = 37 * kSecond_ns;  // of UTC: IEEE 1588 counts TAI
constexpr std::int64_t kNsPerTick = 8;                 // of the register of the tick frequency
constexpr std::uint32_t kFireTestPacket = 0x80000000;  // bits of the packet size register
constexpr std::uint32_t kPacketSizeMask = 0xffff;
constexpr std::uint32_t kLatch = 2, kResetStamp = 1;  // of the time stamp control register
constexpr std::size_t kSentFrames = 4;                // kept for resends
constexpr std::size_t kDatagram = 16384;              // largest received and sent [bytes]
constexpr std::size_t kLeastPacket = 576;
constexpr int kSendBuffer = 1 << 22;  // [bytes]

}  // namespace

GigeDevice::GigeDevice(Config config)
    : config_(std::move(config)),
      network_(networkOf(config_.interface)),
      utc_ahead_ns_(clock_.utcNs() - clock_.monotonicNs()) {}

void GigeDevice::powerOn(std::int64_t shows_ns) {
  zero_mono_ns_ = clock_.monotonicNs();
  shown_ = shows_ns;
  registers_.emplace(network_.address, network_.mask, config_.serial, config_.width, config_.height,
                     config_.bayer, config_.bits);
  listen();
}

void GigeDevice::powerOff() {
  control_.clear();
  stream_ = GigeSocket();
  controller_.reset();
  sent_.clear();
  registers_.reset();
}

void GigeDevice::listen() {
  control_.emplace_back(network_.address, kControlPort, config_.interface);
  // Discovery is broadcast. Without these sockets the camera still answers at its address.
  for (const std::uint32_t broadcast : {network_.broadcast, std::uint32_t{INADDR_BROADCAST}}) try {
      control_.emplace_back(broadcast, kControlPort, config_.interface);
    } catch (const InputError&) {
    }
  stream_ = GigeSocket(network_.address, 0, config_.interface);
  const int no_fragments = IP_PMTUDISC_DO;  // packets larger than the path's MTU are lost, as tests need
  ::setsockopt(stream_.fd(), IPPROTO_IP, IP_MTU_DISCOVER, &no_fragments, sizeof no_fragments);
  ::setsockopt(stream_.fd(), SOL_SOCKET, SO_SNDBUF, &kSendBuffer, sizeof kSendBuffer);
}

bool GigeDevice::streaming() const {
  return controller_ && registers_->get(gige::kAcquisition) == 1 && registers_->get(gige::kStreamPort) != 0;
}

std::int64_t GigeDevice::clockNs(std::int64_t mono_ns) const {
  if (registers_ && registers_->get(gige::kPtpEnable) == 1) return mono_ns + utc_ahead_ns_ + kTaiAheadNs;
  return shown_ + static_cast<std::int64_t>(static_cast<double>(mono_ns - zero_mono_ns_) *
                                            (1 + config_.clock_ppm * 1e-6));
}

std::uint64_t GigeDevice::ticksOf(std::int64_t clock_ns) {
  return static_cast<std::uint64_t>(std::max<std::int64_t>(clock_ns, 0) / kNsPerTick);
}

std::int64_t GigeDevice::exposureNs() const {
  constexpr float kLongestUs = 1e7F;
  const float us = registers_ ? registers_->getFloat(gige::kExposure) : 0;
  return us > 0 ? static_cast<std::int64_t>(std::min(us, kLongestUs)) * kMicrosecond_ns
                : 0;  // not a number: 0
}

std::size_t GigeDevice::dataBytes() const {
  const std::size_t packet = registers_->get(gige::kPacketSize) & kPacketSizeMask;
  return std::clamp(packet, kLeastPacket, kDatagram) - kGvspOverhead;
}

void GigeDevice::serveUntil(std::int64_t mono_ns) {
  const std::int64_t wait = std::clamp<std::int64_t>(mono_ns - clock_.monotonicNs(), 0, kLongestWaitNs);
  std::vector<pollfd> fds;
  for (const GigeSocket& socket : control_) fds.push_back({socket.fd(), POLLIN, 0});
  const timespec timeout{wait / kSecond_ns, wait % kSecond_ns};
  if (::ppoll(fds.data(), fds.size(), &timeout, nullptr) > 0)
    for (std::size_t i = 0; i < fds.size(); ++i)
      if ((fds[i].revents & POLLIN) != 0) take(control_[i]);
  releaseSilentClient();
}

// Releases control when the client's heartbeat has timed out.
void GigeDevice::releaseSilentClient() {
  if (!controller_) return;
  const std::int64_t timeout_ns = registers_->get(gige::kHeartbeatTimeout) * kMillisecond_ns;
  if (clock_.monotonicNs() - heartbeat_mono_ns_ <= timeout_ns) return;
  registers_->set(gige::kControlPrivilege, 0);
  afterWrite(gige::kControlPrivilege, *controller_);
}

void GigeDevice::take(const GigeSocket& socket) {
  std::array<std::uint8_t, kDatagram> datagram;
  for (;;) {
    sockaddr_in from{};
    socklen_t size = sizeof from;
    const ssize_t got = ::recvfrom(socket.fd(), datagram.data(), datagram.size(), 0,
                                   reinterpret_cast<sockaddr*>(&from), &size);
    if (got < 0) return;
    const auto request = parseGvcp({datagram.data(), static_cast<std::size_t>(got)});
    if (request) answer(*request, from);
  }
}

void GigeDevice::answer(const GvcpRequest& request, const sockaddr_in& from) {
  const Client client{ntohl(from.sin_addr.s_addr), ntohs(from.sin_port)};
  if (controller_ == client) heartbeat_mono_ns_ = clock_.monotonicNs();
  std::vector<std::uint8_t> out;
  GvcpStatus status = GvcpStatus::kSuccess;
  switch (static_cast<GvcpCommand>(request.command)) {
    case GvcpCommand::kDiscovery:
      out.resize(gige::kDiscoveryBytes);
      (void)registers_->read(0, out);
      break;
    case GvcpCommand::kReadRegisters:
      status = readRegisters(request.payload, out);
      break;
    case GvcpCommand::kWriteRegisters:
      status = writeRegisters(request.payload, client, out);
      break;
    case GvcpCommand::kReadMemory:
      status = readMemory(request.payload, out);
      break;
    case GvcpCommand::kWriteMemory:
      status = writeMemory(request.payload, client, out);
      break;
    case GvcpCommand::kPacketResend:
      return resend(request.payload);
    default:
      status = GvcpStatus::kNotImplemented;
  }
  if (!request.wants_answer) return;
  const std::vector<std::uint8_t> bytes = gvcpAnswer(request, status, out);
  ::sendto(control_.front().fd(), bytes.data(), bytes.size(), 0, reinterpret_cast<const sockaddr*>(&from),
           sizeof from);
}

GvcpStatus GigeDevice::readRegisters(std::span<const std::uint8_t> in, std::vector<std::uint8_t>& out) const {
  for (std::size_t i = 0; i + 4 <= in.size(); i += 4) {
    std::array<std::uint8_t, 4> value{};
    if (!registers_->read(bigEndianAt<std::uint32_t>(in, i), value)) return GvcpStatus::kInvalidAddress;
    out.insert(out.end(), value.begin(), value.end());
  }
  return GvcpStatus::kSuccess;
}

GvcpStatus GigeDevice::writeRegisters(std::span<const std::uint8_t> in, const Client& client,
                                      std::vector<std::uint8_t>& out) {
  GvcpStatus status = GvcpStatus::kSuccess;
  std::uint16_t written = 0;
  for (std::size_t i = 0; i + 8 <= in.size() && status == GvcpStatus::kSuccess; i += 8) {
    const std::uint32_t address = bigEndianAt<std::uint32_t>(in, i);
    if (controller_ && controller_ != client) {
      status = GvcpStatus::kAccessDenied;
    } else if (!registers_->write(address, in.subspan(i + 4, 4))) {
      status = GvcpStatus::kWriteProtect;
    } else {
      afterWrite(address, client);
      ++written;
    }
  }
  appendBigEndian<std::uint16_t>(out, 0);
  appendBigEndian(out, written);
  return status;
}

GvcpStatus GigeDevice::readMemory(std::span<const std::uint8_t> in, std::vector<std::uint8_t>& out) const {
  if (in.size() < 8) return GvcpStatus::kInvalidParameter;
  const std::uint32_t address = bigEndianAt<std::uint32_t>(in, 0);
  const std::size_t count = bigEndianAt<std::uint16_t>(in, 6);
  appendBigEndian(out, address);
  out.resize(4 + count);
  return count > 0 && registers_->read(address, std::span(out).subspan(4)) ? GvcpStatus::kSuccess
                                                                           : GvcpStatus::kInvalidAddress;
}

GvcpStatus GigeDevice::writeMemory(std::span<const std::uint8_t> in, const Client& client,
                                   std::vector<std::uint8_t>& out) {
  appendBigEndian(out, static_cast<std::uint32_t>(in.size()));
  if (controller_ && controller_ != client) return GvcpStatus::kAccessDenied;
  if (in.size() < 8 || !registers_->write(bigEndianAt<std::uint32_t>(in, 0), in.subspan(4)))
    return GvcpStatus::kWriteProtect;
  afterWrite(bigEndianAt<std::uint32_t>(in, 0), client);
  return GvcpStatus::kSuccess;
}

// Side effects of writing a register.
void GigeDevice::afterWrite(std::uint32_t address, const Client& client) {
  const std::uint32_t value = registers_->get(address);
  const std::int64_t now = clock_.monotonicNs();
  if (address == gige::kControlPrivilege && value != 0) {
    controller_ = client;
    heartbeat_mono_ns_ = now;
  } else if (address == gige::kControlPrivilege) {
    controller_.reset();
    registers_->set(gige::kAcquisition, 0);
  } else if (address == gige::kPacketSize && (value & kFireTestPacket) != 0) {
    registers_->set(address, value & ~kFireTestPacket);
    const std::size_t size = value & kPacketSizeMask;
    if (size >= kLeastPacket && size <= kDatagram) sendPacket(std::vector<std::uint8_t>(size - kUdpOverhead));
  } else if (address == gige::kStampControl) {
    if ((value & kResetStamp) != 0) zero_mono_ns_ = now, shown_ = 0;
    if ((value & kLatch) != 0) {
      const std::uint64_t ticks = ticksOf(clockNs(now));
      registers_->set(gige::kStampHigh, static_cast<std::uint32_t>(ticks >> 32));
      registers_->set(gige::kStampLow, static_cast<std::uint32_t>(ticks));
    }
    registers_->set(address, 0);
  }
}

void GigeDevice::sendPacket(const std::vector<std::uint8_t>& bytes) {
  const sockaddr_in to = socketAddress(registers_->get(gige::kStreamAddress),
                                       static_cast<std::uint16_t>(registers_->get(gige::kStreamPort)));
  // A packet that the system refuses is lost.
  ::sendto(stream_.fd(), bytes.data(), bytes.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
}

void GigeDevice::send(GvspFrame frame, const std::set<std::uint32_t>& lost, std::set<std::uint32_t> never) {
  const std::int64_t gap_ns = std::int64_t{registers_->get(gige::kPacketDelay)} * kNsPerTick;
  std::vector<std::uint8_t> bytes;
  std::int64_t at = clock_.monotonicNs();
  for (std::uint32_t n = 0; n < frame.packets(); ++n) {
    // Lost packets take time on the wire, too.
    if (gap_ns > 0) clock_.sleepUntil(at += gap_ns);
    if (lost.contains(n)) continue;
    frame.packet(n, bytes);
    sendPacket(bytes);
  }
  if (sent_.size() == kSentFrames) sent_.erase(sent_.begin());
  sent_.push_back({std::move(frame), std::move(never)});
}

void GigeDevice::resend(std::span<const std::uint8_t> in) {
  constexpr std::uint32_t kPacketNumber = 0x00ffffff;
  if (in.size() < 12) return;
  const std::uint16_t id = bigEndianAt<std::uint16_t>(in, 2);
  const std::uint32_t first = bigEndianAt<std::uint32_t>(in, 4) & kPacketNumber,
                      last = bigEndianAt<std::uint32_t>(in, 8) & kPacketNumber;
  std::vector<std::uint8_t> bytes;
  for (const Sent& sent : sent_) {
    if (sent.frame.id != id) continue;
    for (std::uint32_t n = first; n <= last && n < sent.frame.packets(); ++n) {
      if (sent.never.contains(n)) continue;
      sent.frame.packet(n, bytes);
      sendPacket(bytes);
    }
  }
}

}  // namespace fathom::sim
