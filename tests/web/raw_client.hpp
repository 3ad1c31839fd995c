#pragma once

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <fstream>
#include <string>
#include <string_view>

namespace fathom::test {

// A connection to a server on this machine that sends bytes as they are.
class RawClient {
 public:
  explicit RawClient(int port, int receive_buffer = 0) : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(static_cast<std::uint16_t>(port));
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (receive_buffer > 0)
      ::setsockopt(socket_, SOL_SOCKET, SO_RCVBUF, &receive_buffer, sizeof receive_buffer);
    const timeval patience{15, 0};
    ::setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    ::setsockopt(socket_, SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
    connected_ = ::connect(socket_, reinterpret_cast<const sockaddr*>(&to), sizeof to) == 0;
  }
  ~RawClient() {
    if (socket_ >= 0) ::close(socket_);
  }
  RawClient(RawClient&& other) noexcept : socket_(other.socket_), connected_(other.connected_) {
    other.socket_ = -1;
  }
  RawClient(const RawClient&) = delete;
  RawClient& operator=(const RawClient&) = delete;

  [[nodiscard]] bool connected() const { return connected_; }
  // How much the server took before it closed, or would not take more for long.
  std::size_t send(std::string_view bytes) {
    std::size_t sent = 0;
    while (sent < bytes.size()) {
      const ssize_t n = ::send(socket_, bytes.data() + sent, bytes.size() - sent, MSG_NOSIGNAL);
      if (n <= 0) break;
      sent += static_cast<std::size_t>(n);
    }
    return sent;
  }
  // What has come, or comes next; empty: the server closed.
  std::string receiveSome() {
    std::array<char, 65536> part{};
    const ssize_t n = ::recv(socket_, part.data(), part.size(), 0);
    return {part.data(), n > 0 ? static_cast<std::size_t>(n) : 0};
  }
  // What comes until the server closes.
  std::string receive() {
    std::string answer;
    for (std::string part; !(part = receiveSome()).empty();) answer += part;
    return answer;
  }
  // Whether the server has closed, or does within so many milliseconds; what it sends meanwhile is not read.
  [[nodiscard]] bool closesWithin(int ms) const {
    pollfd one{socket_, POLLRDHUP, 0};
    return ::poll(&one, 1, ms) > 0;
  }

 private:
  int socket_;
  bool connected_ = false;
};

inline std::string answerTo(int port, std::string_view bytes) {
  RawClient client(port);
  client.send(bytes);
  return client.receive();
}

// The memory of this process that is resident [bytes]; 0 under sanitizers, which hold back what is freed.
inline std::size_t residentBytes() {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  return 0;
#endif
  std::size_t total = 0, resident = 0;
  std::ifstream("/proc/self/statm") >> total >> resident;
  return resident * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
}

}  // namespace fathom::test
