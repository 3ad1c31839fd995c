#include "firmware_if/devices/can/bus/socket_can.hpp"

#include <fcntl.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <limits>

#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

constexpr std::int64_t kReopenCan_ns = kSecond_ns;
// Requested SO_RCVBUF, which the kernel doubles. A queued frame takes some 800 bytes and a saturated bus of
// 250 kbit/s delivers about 1,900 a second: room for more than two seconds.
constexpr int kCanReceiveBuffer_bytes = 2 * 1024 * 1024;

std::int64_t systemNs() noexcept {
  timespec now = {};
  ::clock_gettime(CLOCK_REALTIME, &now);
  return now.tv_sec * kSecond_ns + now.tv_nsec;
}

struct Now {
  std::int64_t system_ns = 0, vehicle_ns = 0;
};

// Reads both clocks at one moment: of up to three readings, the one that took least time.
Now readClocks(const rt::Clock& vehicle) noexcept {
  constexpr int kTries = 3;
  constexpr std::int64_t kShortReading_ns = 20'000;
  Now out;
  std::int64_t best_ns = std::numeric_limits<std::int64_t>::max();
  for (int i = 0; i < kTries && best_ns > kShortReading_ns; ++i) {
    const std::int64_t before_ns = vehicle.utcNs(), system_ns = systemNs();
    const std::int64_t took_ns = vehicle.utcNs() - before_ns;
    if (took_ns >= best_ns) continue;
    best_ns = took_ns;
    out = {system_ns, before_ns + took_ns / 2};
  }
  return out;
}

bool isGone(int error) noexcept {
  return error == ENETDOWN || error == ENODEV || error == ENXIO || error == EBADF;
}

// Accepts a parameter group from any source. In PDU1 groups (PDU format below 240) the specific field is the
// destination: any of them.
can_filter filterOf(std::uint32_t pgn) noexcept {
  const bool is_pdu1 = ((pgn >> 8) & 0xFF) < 240;
  can_filter out = {};
  out.can_id = (pgn << 8) | CAN_EFF_FLAG;
  out.can_mask = (is_pdu1 ? 0x03FF0000U : 0x03FFFF00U) | CAN_EFF_FLAG | CAN_RTR_FLAG;
  return out;
}

}  // namespace

std::string_view CanErrors::name(Kind kind) noexcept {
  constexpr std::array<std::string_view, kKinds> kErrorNames = {
      "tx_timeout",     "lost_arbitration",  "controller_overflow", "error_warning", "error_passive",
      "protocol_error", "transceiver_error", "no_acknowledge",      "bus_off",       "bus_error",
      "restarted"};
  return kErrorNames[kind];
}

void CanErrors::add(std::uint32_t classes, std::span<const std::uint8_t> data) noexcept {
  ++frames_;
  const auto note = [&](bool so, Kind kind) { counts_[kind] += so ? 1 : 0; };
  const auto byte = [&](std::size_t at) { return at < data.size() ? data[at] : std::uint8_t{0}; };
  note((classes & CAN_ERR_TX_TIMEOUT) != 0, kTxTimeout);
  note((classes & CAN_ERR_LOSTARB) != 0, kLostArbitration);
  if ((classes & CAN_ERR_CRTL) != 0) {
    const std::uint8_t controller = byte(1);
    note((controller & (CAN_ERR_CRTL_RX_OVERFLOW | CAN_ERR_CRTL_TX_OVERFLOW)) != 0, kControllerOverflow);
    note((controller & (CAN_ERR_CRTL_RX_WARNING | CAN_ERR_CRTL_TX_WARNING)) != 0, kErrorWarning);
    note((controller & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE)) != 0, kErrorPassive);
    if ((controller & CAN_ERR_CRTL_ACTIVE) != 0) bus_off_ = false;
  }
  note((classes & CAN_ERR_PROT) != 0, kProtocol);
  note((classes & CAN_ERR_TRX) != 0, kTransceiver);
  note((classes & CAN_ERR_ACK) != 0, kNoAcknowledge);
  note((classes & CAN_ERR_BUSERROR) != 0, kBusError);
  if ((classes & CAN_ERR_BUSOFF) != 0) {
    note(true, kBusOff);
    bus_off_ = true;
  }
  if ((classes & CAN_ERR_RESTARTED) != 0) {
    note(true, kRestarted);
    bus_off_ = false;
  }
}

SocketCan::SocketCan(std::string interface, std::span<const std::uint32_t> pgns, const rt::Clock& vehicle)
    : interface_(std::move(interface)), vehicle_(vehicle) {
  if (interface_.empty() || interface_.size() >= IFNAMSIZ ||
      interface_.find_first_of("/ \t\n") != std::string::npos)
    throw InputError(interface_, "", "is not the name of a CAN interface; give one like can0");
  for (const std::uint32_t pgn : pgns) filters_.push_back(filterOf(pgn));
  open();
}

SocketCan::~SocketCan() {
  if (fd_ >= 0) ::close(fd_);
}

void SocketCan::open() noexcept {
  const std::int64_t now_ns = vehicle_.monotonicNs();
  if (now_ns < next_open_ns_) return;
  next_open_ns_ = now_ns + kReopenCan_ns;
  const int fd = ::socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
  if (fd < 0) return;
  ifreq request = {};
  std::memcpy(request.ifr_name, interface_.c_str(), interface_.size());
  const bool is_up = ::ioctl(fd, SIOCGIFFLAGS, &request) == 0 && (request.ifr_flags & IFF_UP) != 0;
  const bool has_index = is_up && ::ioctl(fd, SIOCGIFINDEX, &request) == 0;
  const auto set = [fd](int level, int option, const auto& value) {
    return ::setsockopt(fd, level, option, &value, sizeof value) == 0;
  };
  sockaddr_can address = {};
  address.can_family = AF_CAN;
  address.can_ifindex = request.ifr_ifindex;
  const can_err_mask_t every_error = CAN_ERR_MASK;
  if (!has_index ||
      ::setsockopt(fd, SOL_CAN_RAW, CAN_RAW_FILTER, filters_.data(),
                   static_cast<socklen_t>(filters_.size() * sizeof(can_filter))) != 0 ||
      !set(SOL_CAN_RAW, CAN_RAW_ERR_FILTER, every_error) || !set(SOL_SOCKET, SO_TIMESTAMPNS, 1) ||
      !set(SOL_SOCKET, SO_RXQ_OVFL, 1) ||
      ::bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    ::close(fd);
    return;
  }
  // More than net.core.rmem_max needs CAP_NET_ADMIN; without it, what the kernel grants is used.
  if (!set(SOL_SOCKET, SO_RCVBUFFORCE, kCanReceiveBuffer_bytes))
    static_cast<void>(set(SOL_SOCKET, SO_RCVBUF, kCanReceiveBuffer_bytes));
  fd_ = fd;
  socket_drops_ = 0;
  drained();
}

void SocketCan::close() noexcept {
  ::close(fd_);
  fd_ = -1;
  ++counts_.disconnects;
  errors_.alive();
}

SocketCan::Read SocketCan::read(BusFrame& out) noexcept {
  can_frame frame = {};
  iovec part = {&frame, sizeof frame};
  alignas(cmsghdr) std::array<char, 128> control;
  msghdr message = {};
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  message.msg_control = control.data();
  message.msg_controllen = control.size();
  const ssize_t size = ::recvmsg(fd_, &message, 0);
  if (size < 0) {
    if (errno == EINTR) return Read::kSkipped;
    if (isGone(errno)) close();
    return Read::kNothing;
  }
  const Now now = readClocks(vehicle_);
  std::int64_t stamp_ns = now.system_ns;
  for (const cmsghdr* c = CMSG_FIRSTHDR(&message); c != nullptr;
       c = CMSG_NXTHDR(&message, const_cast<cmsghdr*>(c))) {
    if (c->cmsg_level != SOL_SOCKET) continue;
    if (c->cmsg_type == SCM_TIMESTAMPNS) {
      timespec stamp = {};
      std::memcpy(&stamp, CMSG_DATA(c), sizeof stamp);
      stamp_ns = stamp.tv_sec * kSecond_ns + stamp.tv_nsec;
    } else if (c->cmsg_type == SO_RXQ_OVFL) {
      std::uint32_t drops = 0;
      std::memcpy(&drops, CMSG_DATA(c), sizeof drops);
      counts_.kernel_drops += drops - socket_drops_;
      socket_drops_ = drops;
    }
  }
  const bool error = (frame.can_id & CAN_ERR_FLAG) != 0;
  if (size != CAN_MTU || frame.len > CAN_MAX_DLEN || (!error && (frame.can_id & CAN_EFF_FLAG) == 0) ||
      (frame.can_id & CAN_RTR_FLAG) != 0) {
    ++counts_.ill_formed;
    return Read::kSkipped;
  }
  out.error = error;
  out.frame.utc_ns = receive_time_.toVehicle(stamp_ns, now.system_ns, now.vehicle_ns);
  out.frame.id = frame.can_id & CAN_EFF_MASK;
  out.frame.size = frame.len;
  std::copy_n(frame.data, CAN_MAX_DLEN, out.frame.data.begin());
  if (error) {
    errors_.add(out.frame.id, out.frame.bytes());
  } else {
    ++counts_.frames;
    errors_.alive();
  }
  return Read::kFrame;
}

void SocketCan::drained() noexcept {
  const Now now = readClocks(vehicle_);
  receive_time_.drained(now.system_ns, now.vehicle_ns);
}

std::span<const BusFrame> SocketCan::receive(int timeout_ms) noexcept {
  if (fd_ < 0) open();
  pollfd socket = {fd_, POLLIN, 0};
  // Without a socket this sleeps for the timeout.
  const int ready = ::poll(&socket, fd_ < 0 ? 0 : 1, std::max(timeout_ms, 0));
  if (ready <= 0 || fd_ < 0) {
    if (fd_ >= 0 && ready == 0) drained();
    return {};
  }
  std::size_t count = 0;
  // Reads that give no frame (interrupted, ill-formed) are bounded too, so that none can hold the caller.
  for (std::size_t reads = 0; count < kBatch && reads < 2 * kBatch; ++reads) {
    const Read result = read(batch_[count]);
    if (result == Read::kNothing) break;
    if (result == Read::kFrame) ++count;
  }
  if (count < kBatch) drained();
  return {batch_.data(), count};
}

bool SocketCan::send(const CanFrame& frame) noexcept {
  if (fd_ < 0) return false;
  can_frame out = {};
  out.can_id = frame.id | CAN_EFF_FLAG;
  out.len = frame.size;
  std::copy_n(frame.data.begin(), frame.size, out.data);
  const ssize_t size = ::write(fd_, &out, sizeof out);
  if (size == sizeof out) {
    ++counts_.sent;
    return true;
  }
  if (size < 0 && isGone(errno)) close();
  return false;
}

}  // namespace fathom::io
