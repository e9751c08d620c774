// Any bytes as the log of steps: in a datagram, and in the server's ring by any numbers at any time. What is
// read keeps PROTOCOL.md's ranges and is written again to the same steps; each step is executed once, in
// order, with what was sent under its number, and never more time than the wall has.
#include <array>
#include <map>

#include "fuzz_input.h"
#include "telenano/common/link/step_log.h"

namespace {

using namespace telenano::link;
using telenano::fuzz::Script;

constexpr std::size_t kRing = 96;

void check_ranges(const StepBatch& batch) {
  FUZZ_CHECK(batch.first >= 1 && batch.count >= 1 && batch.count <= kMaxBatch);
  for (std::size_t i = 0; i < batch.count; ++i) {
    const LoggedStep& step = batch.step[i];
    for (const std::int64_t target : step.target)
      FUZZ_CHECK(target <= kStepTargetMost && target >= -kStepTargetMost);
    FUZZ_CHECK(step.dt_ns >= kStepShortestNs && step.dt_ns <= kStepLongestNs);
    FUZZ_CHECK((step.flags & ~kStepFlags) == 0);
  }
}

void check_written_again(const StepBatch& batch) {
  std::array<std::uint8_t, kStepsBytesMost> bytes{};
  StepWriter writer(bytes, batch.first);
  std::size_t written = 0;
  while (written < batch.count && writer.add(batch.step[written])) ++written;
  StepBatch again;
  FUZZ_CHECK(read_steps(std::span(bytes).first(writer.size()), again));
  FUZZ_CHECK(again.first == batch.first && again.count == written);
  for (std::size_t i = 0; i < written; ++i) FUZZ_CHECK(again.step[i] == batch.step[i]);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  StepBatch batch;
  if (read_steps({data, size}, batch)) {
    check_ranges(batch);
    check_written_again(batch);
  } else {
    FUZZ_CHECK(batch.count == 0);
  }

  // The same bytes as a script: a batch of steps under some number, some time, some executed, a skip.
  Script script(data, size);
  const std::uint64_t before = script.byte();
  StepReceiver receiver(kRing);
  std::int64_t now_ns = 1'000'000'000;
  const std::int64_t begin_ns = now_ns;
  std::uint64_t executed = 0;
  double executed_ns = 0;
  std::map<std::uint64_t, LoggedStep> first_sent;
  while (!script.done()) {
    const std::uint8_t what = script.byte();
    switch (what & 3u) {
      case 0: {
        StepBatch sent;
        sent.first =
            executed + 1 + script.byte() % (2 * kRing) - std::min<std::uint64_t>(executed, before % 16);
        sent.count = 1 + (what >> 2) % kMaxBatch;
        for (std::size_t i = 0; i < sent.count; ++i) {
          sent.step[i].target = {static_cast<std::int64_t>(sent.first + i), what, 0};
          sent.step[i].dt_ns = kStepShortestNs + (what >> 4) * 6'000'000u;
          first_sent.emplace(sent.first + i, sent.step[i]);
        }
        receiver.take(sent, now_ns);
        break;
      }
      case 1:
        now_ns += std::int64_t{script.byte()} * 1'000'000;
        break;
      case 2: {
        LoggedStep step;
        for (int i = 0; i < 1 + (what >> 2) && receiver.pop(now_ns, step); ++i) {
          FUZZ_CHECK(receiver.executed() == executed + 1);
          executed = receiver.executed();
          // Its own number, as somebody has sent it.
          FUZZ_CHECK(first_sent.contains(executed));
          FUZZ_CHECK(step.target[0] == static_cast<std::int64_t>(executed));
          executed_ns += step.dt_ns;
        }
        break;
      }
      default:
        if ((what >> 2) % 8 == 0) receiver.skip_to_newest(kBreakGap);
        FUZZ_CHECK(receiver.executed() >= executed);
        executed = receiver.executed();
    }
    FUZZ_CHECK(receiver.executed() <= receiver.newest());
    FUZZ_CHECK(receiver.executed() == executed);
    FUZZ_CHECK(executed_ns <= StepReceiver::kFill * static_cast<double>(now_ns - begin_ns) +
                                  StepReceiver::kBucketNs + kStepLongestNs);
    FUZZ_CHECK(!(receiver.gap() && receiver.waits()));
    FUZZ_CHECK(receiver.report().executed == executed && receiver.report().newest == receiver.newest());
  }
  return 0;
}
