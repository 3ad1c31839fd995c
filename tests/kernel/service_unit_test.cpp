#include <fnmatch.h>
#include <gmock/gmock.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cstring>
#include <map>

#include "realtime/base/input_error.hpp"
#include "realtime/kernel/threads/arming.hpp"
#include "realtime/kernel/threads/realtime_config.hpp"
#include "realtime/kernel/threads/service_notify.hpp"
#include "tests/support/program_run.hpp"

namespace fathom::rt {
namespace {

std::string unitText() {
  return test::readText(FATHOM_SOURCE_DIR "/realtime/onboard/service/fathom-onboard.service");
}

// [Service] of a unit: a key's values, in their order.
using Service = std::map<std::string, std::vector<std::string>>;
Service parseService(const std::string& unit) {
  Service service;
  std::istringstream lines(unit);
  bool inside = false;
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("[")) inside = line == "[Service]";
    const std::size_t equals = line.find('=');
    if (!inside || line.starts_with("#") || equals == std::string::npos) continue;
    service[line.substr(0, equals)].push_back(line.substr(equals + 1));
  }
  return service;
}
std::string only(const Service& service, const std::string& key) {
  const auto found = service.find(key);
  return found == service.end() || found->second.size() != 1 ? "" : found->second[0];
}
// "30" and "100ms" as systemd reads them [s].
double seconds(const std::string& text) {
  return std::stod(text) * (text.ends_with("ms") ? 1e-3 : 1);
}

// Whether a unit admits a character device while it runs, as systemd 252 makes its rules (bpf-devices.c): a
// class is looked up in /proc/devices when the program starts, "*" and numbers are not, a path must be there
// then.
struct CharDevice {
  std::string name;
  int major = 0;
};
bool admits(const Service& service, const std::vector<CharDevice>& classes_at_start,
            const CharDevice& device) {
  if (service.count("DevicePolicy") == 0 && service.count("DeviceAllow") == 0) return true;
  const auto rules = service.find("DeviceAllow");
  if (rules == service.end()) return false;
  for (const std::string& rule : rules->second) {
    std::istringstream words(rule);
    std::string what, access;
    words >> what >> access;
    if (!what.starts_with("char-") || access.find("rw") == std::string::npos) continue;
    const std::string pattern = what.substr(5);
    if (pattern == "*" || pattern == std::to_string(device.major)) return true;
    for (const CharDevice& known : classes_at_start)
      if (known.major == device.major && ::fnmatch(pattern.c_str(), known.name.c_str(), 0) == 0) return true;
  }
  return false;
}

// What systemd-analyze has to say against the unit; "" when all is well. It wants the program itself to be
// there, so that a copy of the unit names one that is.
std::string complaints(std::string unit) {
  const std::string key = "\nExecStart=";
  const std::size_t at = unit.find(key);
  EXPECT_NE(at, std::string::npos);
  const std::size_t end = unit.find('\n', at + 1);
  unit.replace(at, end - at, key + "/bin/true");
  const test::TemporaryFolder folder;
  const std::string path = (folder.path() / "fathom-onboard.service").string();
  test::writeText(path, unit);
  const test::Outcome run = test::runCommand("systemd-analyze verify --man=no " + path);
  return run.out + run.err;
}

bool analyzerThere() {
  return test::runCommand("systemd-analyze --version").exit_code == 0;
}

TEST(ServiceUnit, SystemdHasNothingToSayAgainstIt) {
  if (!analyzerThere()) GTEST_SKIP() << "systemd-analyze is absent; install systemd";
  EXPECT_EQ(complaints(unitText()), "");
}

TEST(ServiceUnit, AMisspeltKeyWouldBeSeen) {
  if (!analyzerThere()) GTEST_SKIP() << "systemd-analyze is absent; install systemd";
  EXPECT_THAT(complaints(unitText() + "\n[Service]\nLimitRTPRI=80\n"), testing::HasSubstr("LimitRTPRI"));
}

TEST(ServiceUnit, GrantsWhatArmingAsksForByDefault) {
  const Service unit = parseService(unitText());
  EXPECT_GE(std::stoi(only(unit, "LimitRTPRIO")), highestPriority({}));
  EXPECT_EQ(only(unit, "LimitMEMLOCK"), "infinity");
  EXPECT_EQ(only(unit, "Type"), "notify");
  EXPECT_NE(only(unit, "RestrictRealtime"), "yes");
}

TEST(ServiceUnit, ACrashIsStartedAgainAtOnceAndBadInputNotAtAll) {
  const Service unit = parseService(unitText());
  EXPECT_EQ(only(unit, "Restart"), "on-failure");
  EXPECT_LE(seconds(only(unit, "RestartSec")), 0.5);
  EXPECT_EQ(only(unit, "RestartPreventExitStatus"), std::to_string(kExitBadInput))
      << "not failed work or a signal";
}

TEST(ServiceUnit, TheEndOfADiveIsNotCutShortAndAProgramThatHangsIsNotWaitedFor) {
  const Service unit = parseService(unitText());
  constexpr double kEndWithin = 150;  // of the program itself [s]
  EXPECT_GE(seconds(only(unit, "TimeoutStopSec")), kEndWithin + 20);
  EXPECT_LE(seconds(only(unit, "WatchdogSec")) + seconds(only(unit, "TimeoutAbortSec")), 10);
}

TEST(ServiceUnit, AdmitsEverySerialPortAlsoOfAnAdapterThatIsPoweredLater) {
  const Service unit = parseService(unitText());
  // The classes of a small computer's boot: no adapter is plugged, no driver of one loaded.
  const std::vector<CharDevice> at_start = {{"mem", 1}, {"tty", 4}, {"ttyS", 4}, {"misc", 10}, {"pts", 136}};
  for (const CharDevice& port : std::vector<CharDevice>{{"ttyS", 4},
                                                        {"ttyUSB", 188},
                                                        {"ttyACM", 166},
                                                        {"ttyAMA", 204},
                                                        {"ttymxc", 207},
                                                        {"ttyTHS", 238},
                                                        {"ttyPS", 240},
                                                        {"ttyXRUSB", 241},
                                                        {"pts", 136},
                                                        {"cpu_dma_latency", 10}})
    EXPECT_TRUE(admits(unit, at_start, port)) << port.name;
  Service by_class;
  by_class["DevicePolicy"] = {"closed"};
  by_class["DeviceAllow"] = {"char-ttyUSB rw", "char-ttyS rw"};
  EXPECT_TRUE(admits(by_class, at_start, {"ttyS", 4}));
  EXPECT_FALSE(admits(by_class, at_start, {"ttyUSB", 188}))
      << "its class is not known when the program starts";
}

TEST(ServiceUnit, LetsTheProgramAskWhetherTheClockIsSynchronisedAndNotSetIt) {
  const Service unit = parseService(unitText());
  EXPECT_EQ(unit.count("ProtectClock"), 0u) << "its filter bars adjtimex also for reading";
  EXPECT_EQ(unit.count("SystemCallFilter"), 0u);
  EXPECT_EQ(only(unit, "CapabilityBoundingSet"), "CAP_NET_RAW");
}

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
