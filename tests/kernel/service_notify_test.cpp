#include "realtime/kernel/threads/service_notify.hpp"

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <cstring>
#include <string>

#include "realtime/kernel/threads/arming.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::rt {
namespace {

// Stands for systemd: the socket that it listens on.
class ServiceManager {
 public:
  ServiceManager() : path_((folder_.path() / "notify").string()) {
    socket_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0);
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strncpy(address.sun_path, path_.c_str(), sizeof address.sun_path - 1);
    EXPECT_EQ(::bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    ::setenv("NOTIFY_SOCKET", path_.c_str(), 1);
  }
  ~ServiceManager() {
    ::unsetenv("NOTIFY_SOCKET");
    ::close(socket_);
  }
  ServiceManager(const ServiceManager&) = delete;
  ServiceManager& operator=(const ServiceManager&) = delete;
  [[nodiscard]] std::string received() const {
    std::array<char, 512> buffer{};
    const ssize_t got = ::recv(socket_, buffer.data(), buffer.size(), 0);
    return got < 0 ? "" : std::string(buffer.data(), static_cast<std::size_t>(got));
  }

 private:
  test::TemporaryFolder folder_;
  std::string path_;
  int socket_;
};

TEST(ServiceNotify, TellsTheServiceManagerWhatItMustKnow) {
  const ServiceManager manager;
  ServiceNotify::ready("armed, 100 Hz");
  EXPECT_EQ(manager.received(), "READY=1\nSTATUS=armed, 100 Hz");
  ServiceNotify::alive();
  EXPECT_EQ(manager.received(), "WATCHDOG=1");
  ServiceNotify::stopping();
  EXPECT_EQ(manager.received(), "STOPPING=1");
}

TEST(ServiceNotify, AStatusCannotCarryAnotherMessage) {
  const ServiceManager manager;
  ServiceNotify::status("two\nREADY=1");
  EXPECT_EQ(manager.received(), "STATUS=two READY=1");
}

TEST(ServiceNotify, WithoutAServiceManagerNothingHappens) {
  {
    const ServiceManager manager;
    EXPECT_TRUE(ServiceNotify::kept());
  }
  ::unsetenv("NOTIFY_SOCKET");
  EXPECT_FALSE(ServiceNotify::kept());
  ServiceNotify::ready("alone");
  ServiceNotify::alive();
}

TEST(CpuWakeLimit, ANegativeLimitLeavesTheMachineAsItIs) {
  EXPECT_FALSE(CpuWakeLimit(-1).held());
  const CpuWakeLimit limit(50);
  EXPECT_EQ(limit.held(), ::access("/dev/cpu_dma_latency", W_OK) == 0);
}

}  // namespace
}  // namespace fathom::rt
