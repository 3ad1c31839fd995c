#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "realtime/kernel/frame_port.hpp"
#include "realtime/kernel/retry_wait.hpp"

namespace fathom::io {

// The port of a modem that need not be there yet: opened by itself, at once and then after 1, 2, 4... 16 s.
// Until then send() refuses and nothing comes. Once open, the port looks after its device itself. One thread
// uses it.
class WaitingFramePort final : public FramePort {
 public:
  static constexpr std::int64_t kFirstWaitNs = 1'000'000'000, kLongestWaitNs = 16'000'000'000;
  using Open = std::function<std::unique_ptr<FramePort>()>;  // throws while the device cannot be used

  explicit WaitingFramePort(Open open, std::int64_t first_wait_ns = kFirstWaitNs);

  [[nodiscard]] bool send(std::span<const std::uint8_t> frame) noexcept override;
  [[nodiscard]] std::size_t receive(std::span<std::uint8_t> buffer) noexcept override;
  void answerHeard() noexcept override;
  [[nodiscard]] std::uint64_t droppedFrames() const noexcept override;
  [[nodiscard]] bool isOpen() const noexcept override;
  [[nodiscard]] std::string_view reason() const noexcept override;

 private:
  bool ready() noexcept;

  Open open_;
  std::unique_ptr<FramePort> port_;
  rt::RetryWait wait_;
  std::string reason_;
};

}  // namespace fathom::io
