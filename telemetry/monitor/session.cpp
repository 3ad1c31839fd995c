#include "telemetry/monitor/session.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <exception>
#include <iostream>
#include <sstream>
#include <string>

#include "realtime/base/input_error.hpp"
#include "telemetry/wire/packet_log.hpp"

namespace fathom::monitor {

using namespace std::chrono_literals;
using telemetry::FrameVerdict;
using Clock = std::chrono::steady_clock;

namespace {
constexpr const char* kReceived = "received.bin";
constexpr auto kTroubleInterval = 1s, kProgressInterval = 10s, kSaveInterval = 30s;
}  // namespace

SessionFiles::SessionFiles(std::filesystem::path folder) : folder_(std::move(folder)) {
  std::error_code error;
  std::filesystem::create_directories(folder_, error);
  if (!error) {
    log_.open(folder_ / "frames.log", std::ios::app);
    received_.reset(::open((folder_ / kReceived).c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644));
  }
  if (error || !log_ || !received_.open())
    throw InputError(folder_.string(), "", "cannot write here: give --out a folder that can be created");
  if (log_.tellp() == 0) log_ << "# utc_ns verdict type vehicle dive sequence bytes\n";
}

SessionFiles::~SessionFiles() {
  (void)keep();
}

std::size_t SessionFiles::reload(const Take& take, const std::function<void()>& on_damage,
                                 std::string& damage) {
  const auto path = folder_ / kReceived;
  telemetry::PacketLogReader reader(path);
  for (std::size_t count = 0;;) {
    const std::uint64_t whole = reader.offset();
    try {
      while (const auto packet = reader.next()) {
        // A stored frame that is no longer whole is damage too.
        const FrameVerdict verdict = take(packet->bytes, packet->utc_ns);
        if (verdict == FrameVerdict::kUnkeyed && damage.empty())
          damage = path.string() + ": holds frames without this key, which are left out: give another --out";
        if (verdict == FrameVerdict::kUnkeyed) continue;
        if (verdict == FrameVerdict::kBadTag) {
          if (damage.empty())
            damage =
                path.string() + ": a frame before byte " + std::to_string(reader.offset()) + " is damaged";
          on_damage();
          continue;
        }
        ++count;
      }
      return count;
    } catch (const InputError& error) {
      const std::uint64_t from = reader.offset();
      on_damage();
      if (reader.passOverDamage()) {
        damage = path.string() + ": bytes " + std::to_string(from) + " to " +
                 std::to_string(reader.offset()) + " are damaged and left out";
        continue;
      }
      std::error_code failed;
      std::filesystem::resize_file(path, std::max(from, whole), failed);
      if (failed) throw;
      damage = std::string(error.what()) + " (the damaged end has been cut off)";
      return count;
    }
  }
}

void SessionFiles::log(const telemetry::DecodedFrame& frame, std::span<const std::uint8_t> bytes,
                       std::int64_t utc_ns, bool recorded) {
  const bool accepted = frame.verdict == FrameVerdict::kAccepted;
  if (accepted && !recorded) {
    std::ostringstream record;
    (void)telemetry::writePacket(record, utc_ns, bytes);
    const std::string text = std::move(record).str();
    if (waiting_.size() + text.size() <= kMostWaiting)
      waiting_.insert(waiting_.end(), text.begin(), text.end());
    else
      ++lost_;
    write();
  }
  if (!accepted && ++rejected_lines_ > kMaxRejectedLines) return;
  log_.clear();  // after a line that a full disk refused
  log_ << utc_ns << ' ' << name(frame.verdict) << ' ';
  if (accepted || frame.verdict >= FrameVerdict::kForeign) {
    log_ << name(frame.header.type) << ' ' << unsigned{frame.header.identity.vehicle_id} << ' '
         << frame.header.identity.dive_id << ' ' << frame.header.sequence();
  } else {
    log_ << "- - - -";
  }
  log_ << ' ' << bytes.size() << std::endl;
}

void SessionFiles::write() {
  if (waiting_.empty()) return;
  synced_ = false;
  struct stat before {};
  const bool known = ::fstat(received_.get(), &before) == 0;
  const ssize_t written = ::write(received_.get(), waiting_.data(), waiting_.size());
  if (written == static_cast<ssize_t>(waiting_.size())) {
    waiting_.clear();
    received_trouble_.clear();
    return;
  }
  received_trouble_ = std::strerror(written < 0 ? errno : ENOSPC);
  // A frame written in part is removed, and written whole when there is room.
  if (written > 0 && known && ::ftruncate(received_.get(), before.st_size) != 0)
    received_trouble_ = std::strerror(errno);
}

bool SessionFiles::keep() {
  write();
  if (!waiting_.empty()) return false;
  if (synced_) return lost_ == 0;
  synced_ = ::fdatasync(received_.get()) == 0;
  if (!synced_) received_trouble_ = std::strerror(errno);
  return synced_ && lost_ == 0;
}

std::string SessionFiles::trouble() const {
  std::string text;
  if (!received_trouble_.empty())
    text = (folder_ / kReceived).string() + " cannot be written (" + received_trouble_ +
           "): " + std::to_string(waiting_.size()) + " bytes wait in memory, and nothing new is acknowledged";
  if (lost_ > 0)
    text += (text.empty() ? "" : "; ") + std::to_string(lost_) + " frames are lost for want of memory";
  return text;
}

SessionKeeper::SessionKeeper(SharedModel& shared, const SessionFiles* files,
                             const std::filesystem::path& folder)
    : shared_(shared), files_(files) {
  if (!folder.empty()) exports_.emplace(folder);
  thread_ = std::thread([this] { run(); });
}

SessionKeeper::~SessionKeeper() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  ends_.notify_all();
  thread_.join();
}

void SessionKeeper::run() {
  auto next_progress = Clock::now() + kProgressInterval, next_save = Clock::now() + kSaveInterval;
  for (bool last = false; !last;) {
    {
      std::unique_lock lock(mutex_);
      last = ends_.wait_for(lock, kTroubleInterval, [this] { return ending_; });
    }
    try {
      const auto now = Clock::now();
      if (last || now >= next_save) {
        next_save = now + kSaveInterval;
        save();
      }
      reportTrouble();
      if (last || now >= next_progress) {
        next_progress = now + kProgressInterval;
        printProgress();
      }
    } catch (const std::exception& error) {
      // Out of memory: tried again the next time.
      std::cerr << "fathom-monitor: " << error.what() << std::endl;
    }
  }
}

void SessionKeeper::save() {
  if (!exports_) return;
  view_.refresh(shared_);
  exports_->save(view_);
}

void SessionKeeper::reportTrouble() {
  std::string now;
  {
    const std::lock_guard lock(shared_.mutex);
    if (files_ != nullptr) now = files_->trouble();
    if (exports_ && !exports_->trouble().empty()) now += (now.empty() ? "" : "; ") + exports_->trouble();
    if (now == trouble_) return;
    shared_.not_kept = now;
  }
  trouble_ = std::move(now);
  std::cerr << "fathom-monitor: " << (trouble_.empty() ? "everything is stored again" : trouble_)
            << std::endl;
}

void SessionKeeper::printProgress() {
  std::ostringstream line;
  {
    const std::lock_guard lock(shared_.mutex);
    const MonitorModel& model = *shared_.model;
    if (model.version() == printed_version_) return;
    printed_version_ = model.version();
    const auto& c = model.receiver().counters();
    const std::uint64_t accepted = c[telemetry::FrameVerdict::kAccepted];
    line << "frames " << accepted << " accepted, " << c.lost << " lost, " << c.repaired << " repaired, "
         << c.frames - accepted << " rejected; " << c.bytes << " bytes; ";
    view_.take(model, shared_.epoch, shared_.now_utc_ns);
  }
  line << "map " << view_.store().size() << " blocks, " << static_cast<long>(view_.surface().area())
       << " m2; track " << view_.track().size() << " points";
  std::cout << line.str() << std::endl;
}

}  // namespace fathom::monitor
