// Runs one command inside a user-mode Linux; see README.md for what it is for and what its disk means.

#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/statvfs.h>
#include <sys/vfs.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "realtime/base/command_line.hpp"
#include "tests/uml/machine_files.hpp"

extern char** environ;  // NOLINT: POSIX

namespace {

namespace fs = std::filesystem;
using namespace fathom::uml;
using SteadyClock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;

// Exit statuses besides the command's own.
constexpr const char* kRegistersTooLarge = "ptrace set fp regs failed";  // of its console
constexpr int kTimeLimit = 124;                                          // as timeout(1) gives
constexpr int kNoMachine = 125;  // it did not boot, or could not be set up
constexpr int kEndedBeforeCut = 126;

struct Options {
  std::vector<std::string> command;
  bool can = false;
  fs::path disk, since;
  int format_mib = 0;
  std::optional<double> cut_after_s;
  std::optional<std::uint64_t> cache_seed;
  double limit_s = 60;
  int memory_mib = 192;
};

std::string readText(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream out;
  out << in.rdbuf();
  return out.str();
}

void writeList(const fs::path& path, const std::vector<std::string>& list) {
  std::ofstream out(path, std::ios::binary);
  for (const std::string& item : list) out << item << '\0';
  if (!out.flush()) throw std::runtime_error(path.string() + " cannot be written");
}

// Forks, execs; the child gets only /dev/null and `log`.
pid_t start(std::vector<std::string> arguments, const fs::path& log,
            const std::vector<std::pair<std::string, std::string>>& variables) {
  std::vector<char*> pointers;
  for (std::string& argument : arguments) pointers.push_back(argument.data());
  pointers.push_back(nullptr);
  const pid_t child = ::fork();
  if (child != 0) return child;
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  ::setpgid(0, 0);
  const int in = ::open("/dev/null", O_RDONLY);
  const int out = ::open(log.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0644);
  ::dup2(in, STDIN_FILENO);
  ::dup2(out, STDOUT_FILENO);
  ::dup2(out, STDERR_FILENO);
  for (const auto& [name, value] : variables) ::setenv(name.c_str(), value.c_str(), 1);
  ::execvp(pointers[0], pointers.data());
  ::_exit(127);
}

// The machine's memory is a file: /dev/shm where that is large enough and may hold code, else `otherwise`.
fs::path memoryFolder(int memory_mib, const fs::path& otherwise) {
  struct statvfs shm = {};
  if (::statvfs("/dev/shm", &shm) != 0 || (shm.f_flag & ST_NOEXEC) != 0) return otherwise;
  const double free_mib = static_cast<double>(shm.f_bavail) * static_cast<double>(shm.f_frsize) / (1 << 20);
  return free_mib > 1.25 * memory_mib && ::access("/dev/shm", W_OK) == 0 ? "/dev/shm" : otherwise;
}

std::vector<pid_t> children() {
  const std::string self = std::to_string(::getpid());
  std::istringstream in(readText("/proc/" + self + "/task/" + self + "/children"));
  std::vector<pid_t> out;
  for (pid_t child = 0; in >> child;) out.push_back(child);
  return out;
}

// Kills the machine and all its processes, which this process inherits as their subreaper.
void killAll() {
  for (;;) {
    const std::vector<pid_t> left = children();
    for (const pid_t child : left) ::kill(child, SIGKILL);
    if (::waitpid(-1, nullptr, 0) < 0 && errno == ECHILD) return;
  }
}

class JobFolder {
 public:
  JobFolder() {
    std::string name = (fs::temp_directory_path() / "fathom-uml-XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error(name + " cannot be created");
    path_ = name;
  }
  ~JobFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  JobFolder(const JobFolder&) = delete;
  JobFolder& operator=(const JobFolder&) = delete;
  [[nodiscard]] fs::path operator/(const char* name) const { return path_ / name; }
  [[nodiscard]] const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

void formatDisk(const Options& options, const JobFolder& job) {
  std::ofstream(options.disk, std::ios::trunc).flush();
  fs::resize_file(options.disk, static_cast<std::uintmax_t>(options.format_mib) << 20);
  const pid_t child = start({"/usr/sbin/mkfs.ext4", "-q", "-F", options.disk.string()}, job / "mkfs", {});
  int status = 0;
  ::waitpid(child, &status, 0);
  if (status != 0)
    throw std::runtime_error("mkfs.ext4 " + options.disk.string() + ": " + readText(job / "mkfs"));
}

pid_t boot(const Options& options, const JobFolder& job) {
  writeList(job / kArgumentsFile, options.command);
  std::vector<std::string> environment;
  for (char** variable = environ; *variable != nullptr; ++variable) environment.emplace_back(*variable);
  writeList(job / kEnvironmentFile, environment);
  writeList(job / kFolderFile, {fs::current_path().string()});
  if (options.can) writeList(job / kCanFile, {});
  const fs::path programs = fs::read_symlink("/proc/self/exe").parent_path();
  fs::create_symlink(programs / "uml_init", job / "init");

  std::vector<std::string> kernel = {kKernel,
                                     "mem=" + std::to_string(options.memory_mib) + "M",
                                     "root=/dev/root",
                                     "rootfstype=hostfs",
                                     "rootflags=/",
                                     "rw",
                                     "quiet",
                                     "noreboot",
                                     "panic=1",
                                     "con=null",
                                     "ssl=null",
                                     "con0=null,fd:1",
                                     "uml_dir=" + (job.path() / "umid").string(),
                                     "umid=machine",
                                     "init=" + (job.path() / "init").string(),
                                     std::string(kJobVariable) + "=" + job.path().string()};
  if (!options.disk.empty()) {
    fs::create_directory(job / kDiskFolder);
    const std::string image = fs::absolute(options.disk).string();
    if (options.cache_seed) {
      writeList(job / kLoopFile, {image});
    } else {
      kernel.push_back("ubd0=" + image);
    }
  }
  std::vector<std::pair<std::string, std::string>> variables = {
      {"TMPDIR", memoryFolder(options.memory_mib, job.path()).string()}};
  if (options.cache_seed) {
    variables.emplace_back("LD_PRELOAD", (programs / "uml_drive.so").string());
    variables.emplace_back("FATHOM_UML_DRIVE", fs::absolute(options.disk).string());
    variables.emplace_back("FATHOM_UML_DRIVE_SEED", std::to_string(*options.cache_seed));
  }
  return start(kernel, job / "console", variables);
}

double since(SteadyClock::time_point begin) {
  return Seconds(SteadyClock::now() - begin).count();
}

int watch(const Options& options, const JobFolder& job, pid_t machine) {
  constexpr auto kLook = std::chrono::milliseconds(2);
  const auto begin = SteadyClock::now();
  std::optional<SteadyClock::time_point> started;
  for (;;) {
    const bool gone = ::waitpid(machine, nullptr, WNOHANG) == machine;
    if (!started && fs::exists(options.since.empty() ? job / kStartedFile : options.since))
      started = SteadyClock::now();
    if (gone) break;
    if (options.cut_after_s && started && since(*started) >= *options.cut_after_s) {
      killAll();
      if (fs::exists(job / kStatusFile)) break;
      std::fprintf(stderr, "uml_run: power cut %.3f s after the %s\n", since(*started),
                   options.since.empty() ? "command's start" : "file was written");
      return 0;
    }
    if (since(begin) > options.limit_s) {
      killAll();
      std::fprintf(stderr, "uml_run: still running after %.0f s (%s); killed\n", options.limit_s,
                   started ? "the command was" : "the machine was booting");
      return kTimeLimit;
    }
    std::this_thread::sleep_for(kLook);
  }
  killAll();
  if (fs::exists(job / kFailureFile)) {
    std::fprintf(stderr, "uml_run: the machine could not be set up: %s\n",
                 readText(job / kFailureFile).c_str());
    return kNoMachine;
  }
  if (!fs::exists(job / kStatusFile)) {
    const std::string console = readText(job / "console");
    // The registers of this processor (AMX's tiles) need more room than the machine's kernel has.
    if (console.find(kRegistersTooLarge) != std::string::npos) {
      std::fprintf(stderr, "uml_run: skipped: the user-mode Linux cannot set this processor's registers\n");
      return kSkipped;
    }
    std::fprintf(stderr, "uml_run: the machine stopped %s; its console:\n%s\n",
                 started ? "under the command" : "before the command", console.c_str());
    return kNoMachine;
  }
  const int status = std::stoi(readText(job / kStatusFile));
  if (options.cut_after_s) {
    std::fprintf(stderr, "uml_run: the command ended (status %d) before the power was cut\n", status);
    return kEndedBeforeCut;
  }
  return status;
}

int run(const Options& options) {
  if (!fs::exists(kKernel) || !fs::exists(kModulesFolder)) {
    std::fprintf(stderr, "uml_run: skipped: no user-mode Linux here (Debian package user-mode-linux)\n");
    return kSkipped;
  }
  const JobFolder job;
  ::prctl(PR_SET_CHILD_SUBREAPER, 1);
  if (options.format_mib > 0) formatDisk(options, job);
  const int status = watch(options, job, boot(options, job));
  std::cout << readText(job / kOutputFile) << std::flush;
  std::cerr << readText(job / kErrorsFile) << std::flush;
  return status;
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  fathom::CommandLine app(
      "Runs one command inside a user-mode Linux that sees this machine's files, and returns its output and "
      "exit status",
      "", [&options] {
        try {
          return run(options);
        } catch (const std::exception& error) {
          std::fprintf(stderr, "uml_run: %s\n", error.what());
          return kNoMachine;
        }
      });
  app.add_flag("--can", options.can, "Interfaces vcan0 and vcan1 are up");
  auto* disk =
      app.add_option("--disk", options.disk,
                     "File that is the machine's disk; its ext4 file system is mounted at $FATHOM_UML_DISK");
  app.add_option("--format", options.format_mib, "Formats the disk with this size [MiB]")
      ->check(CLI::Range(8, 65536))
      ->needs(disk);
  app.add_option("--volatile-cache", options.cache_seed,
                 "The disk has a write cache that a power cut empties; this seed decides what of it was on "
                 "the medium")
      ->needs(disk);
  app.add_option("--cut-after", options.cut_after_s, "Cuts the power this long after the command's start [s]")
      ->check(CLI::Range(0.0, 3600.0));
  app.add_option("--since", options.since, "The cut counts from when this file is there");
  app.shown("--limit", options.limit_s, "Kills the machine when it runs longer, boot included [s]", 1.0,
            3600.0);
  app.shown("--memory", options.memory_mib, "Of the machine [MiB]", 64, 4096);
  app.add_option("command", options.command, "Command and arguments, behind --")->required();
  return app.run("uml_run", argc, argv);
}
