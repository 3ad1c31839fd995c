#include "tests/onboard/kill/dive_process.hpp"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <sstream>
#include <system_error>

#include "realtime/kernel/frame_port.hpp"
#include "realtime/kernel/time/clock.hpp"

extern char** environ;

namespace fathom::test {
namespace {

std::int64_t monotonicNs() {
  return rt::RealClock().monotonicNs();
}

void require(bool good, const char* what) {
  if (!good) throw std::system_error(errno, std::generic_category(), what);
}

}  // namespace

void Ship::talk(int socket) {
  std::array<std::uint8_t, FramePort::kMaxFrameBytes> frame;
  const auto now = [] { return rt::RealClock().utcNs(); };
  for (;;) {
    const ssize_t size = ::recv(socket, frame.data(), frame.size(), MSG_DONTWAIT);
    if (size <= 0) break;
    (void)link_.accept(now(), std::span<const std::uint8_t>(frame).first(static_cast<std::size_t>(size)),
                       [](const auto&) { return true; });
  }
  if (const std::size_t size = link_.nextFrame(now(), frame))
    (void)::send(socket, frame.data(), size, MSG_DONTWAIT | MSG_NOSIGNAL);
}

DiveProcess::DiveProcess(const DiveOrders& orders, Ship& ship) : ship_(ship) {
  std::array<int, 2> pipe{}, sockets{};
  require(::pipe2(pipe.data(), O_CLOEXEC) == 0, "pipe");
  require(::socketpair(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0, sockets.data()) == 0, "socketpair");
  out_ = pipe[0];
  socket_ = sockets[0];
  posix_spawn_file_actions_t actions;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawn_file_actions_adddup2(&actions, pipe[1], STDOUT_FILENO);
  ::posix_spawn_file_actions_adddup2(&actions, sockets[1], kModemSocket);
  std::vector<std::string> words = {"onboard_kill",         "killed-dive",
                                    orders.folder.string(), orders.mission.string(),
                                    orders.config.string(), "--shift-ns=" + std::to_string(orders.shift_ns)};
  if (orders.hard) words.emplace_back("--hard");
  if (orders.leg_pairs > 0)
    for (const std::string& word :
         {"--leg-pairs=" + std::to_string(orders.leg_pairs), "--from-s=" + std::to_string(orders.from_s),
          "--rate=" + std::to_string(orders.clock.rate),
          "--clock-offset-ns=" + std::to_string(orders.clock.offset_ns),
          "--clock-begin-ns=" + std::to_string(orders.clock.begin_ns)})
      words.push_back(word);
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  life_.spawned_ns = monotonicNs();
  const int error = ::posix_spawn(&pid_, "/proc/self/exe", &actions, nullptr, arguments.data(), environ);
  ::posix_spawn_file_actions_destroy(&actions);
  ::close(pipe[1]);
  ::close(sockets[1]);
  errno = error;
  require(error == 0, "posix_spawn");
}

DiveProcess::~DiveProcess() {
  if (pid_ > 0) {
    ::kill(pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
  }
  ::close(out_);
  ::close(socket_);
}

void DiveLife::take(const std::string& line) {
  if (line.size() < 2) return;
  std::istringstream in(line.substr(2));
  switch (line[0]) {
    case 'R':
      resumed = true;
      in >> said_away_s >> first.emplace();
      break;
    case 'C':
      in >> from.emplace();
      break;
    case 'F':
      in >> first.emplace();
      break;
    case 'A':
      in >> armed_ns;
      break;
    case 'N':
      in >> navigates_ns >> navigates_utc_ns;
      break;
    case 'B':
      in >> follows_ns >> mapper;
      break;
    case 'M': {
      DiveMemory& m = memory.emplace();
      in >> m.pairs >> m.vehicle_kib >> m.mapper_kib >> m.heap_calls >> m.faults >> m.skipped >> m.shed >>
          m.state_kib >> m.saving_ms;
      break;
    }
    case 'S': {
      DiveState s;
      in >> s.mono_ns >> s.utc_ns >> s.pairs >> s.keyframes >> s.tiles >> s.arrived;
      if (states.empty()) caught_up_ns = s.mono_ns;
      states.push_back(s);
      break;
    }
    default:
      said.push_back(line.substr(2));
  }
}

bool DiveProcess::readLines(int timeout_ms) {
  std::array<pollfd, 2> wait = {{{out_, POLLIN, 0}, {socket_, POLLIN, 0}}};
  (void)::poll(wait.data(), wait.size(), timeout_ms);
  ship_.talk(socket_);
  if (wait[0].revents == 0) return true;
  std::array<char, 4096> text;
  const ssize_t size = ::read(out_, text.data(), text.size());
  if (size <= 0) return false;
  half_.append(text.data(), static_cast<std::size_t>(size));
  for (std::size_t end = half_.find('\n'); end != std::string::npos; end = half_.find('\n')) {
    life_.take(half_.substr(0, end));
    half_.erase(0, end + 1);
  }
  return true;
}

bool DiveProcess::listen(const std::function<bool(const DiveLife&, std::int64_t)>& enough) {
  constexpr int kLook_ms = 5;
  while (!enough(life_, monotonicNs()))
    if (!readLines(kLook_ms)) return false;
  return true;
}

bool DiveProcess::killMapper() {
  return life_.mapper > 0 && ::kill(life_.mapper, SIGKILL) == 0;
}

int DiveProcess::end(int signal, std::int64_t utc_offset_ns) {
  constexpr int kLook_ms = 100;
  life_.ended_ns = monotonicNs();
  life_.ended_utc_ns = life_.ended_ns + utc_offset_ns;
  ::kill(pid_, signal);
  while (readLines(kLook_ms)) {
  }
  int status = 0;
  require(::waitpid(pid_, &status, 0) == pid_, "waitpid");
  pid_ = -1;
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

}  // namespace fathom::test
