#include <cstring>
#include <memory>

#include "telenano/common/recording/child_call.h"
#include "telenano/common/recording/packed.h"
#include "telenano/common/recording/recording_source.h"

namespace telenano::recording {
namespace {

enum class Ask : std::uint8_t {
  kFacts,
  kAttribute,
  kColumn,
  kSamples,
  kEvents,
  kDatagrams,
  kMarks,
  kStatePieces,
  kConfiguration
};

template <class T>
std::string rows_of(const std::vector<T>& rows) {
  return Packer().raw(rows.data(), rows.size() * sizeof(T)).take();
}

template <class T>
std::vector<T> rows_from(std::string_view bytes) {
  static_assert(std::is_trivially_copyable_v<T>);
  std::vector<T> rows(bytes.size() / sizeof(T));
  if (!rows.empty()) std::memcpy(static_cast<void*>(rows.data()), bytes.data(), rows.size() * sizeof(T));
  return rows;
}

/// In the other process: opens at the first question, so that what is wrong is an answer.
class Answerer {
 public:
  explicit Answerer(std::filesystem::path path) : path_(std::move(path)) {}

  std::string operator()(std::string_view request) {
    if (!source_) source_ = open_recording(path_);
    Unpacker question(request);
    switch (question.get<Ask>()) {
      case Ask::kFacts: {
        const RecordingFacts& facts = source_->facts();
        Packer answer;
        answer.put(facts.rows).put(facts.closed).put(facts.cut_short).put(facts.rows_dropped);
        for (const std::string& column : facts.columns) answer.text(column);
        return answer.take();
      }
      case Ask::kAttribute: {
        const std::string column = question.text();
        return source_->attribute(column, question.text());
      }
      case Ask::kColumn: {
        const std::string column = question.text();
        return rows_of(source_->read(column, question.get<std::uint64_t>()));
      }
      case Ask::kSamples: {
        const auto first = question.get<std::uint64_t>();
        std::vector<Sample> samples(question.get<std::uint64_t>());
        source_->read_samples(first, samples);
        return rows_of(samples);
      }
      case Ask::kEvents:
        return rows_of(source_->events());
      case Ask::kDatagrams:
        return rows_of(source_->datagrams());
      case Ask::kMarks:
        return rows_of(source_->marks());
      case Ask::kStatePieces:
        return rows_of(source_->state_pieces());
      case Ask::kConfiguration: {
        Packer answer;
        for (const auto& [name, text] : source_->configuration()) answer.text(name).text(text);
        return answer.take();
      }
    }
    return {};
  }

 private:
  std::filesystem::path path_;
  std::shared_ptr<RecordingSource> source_;  // shared only so that it can be copied
};

class IsolatedSource final : public RecordingSource {
 public:
  explicit IsolatedSource(const std::filesystem::path& path) : child_(path.string(), Answerer(path)) {
    const std::string answer = child_.ask(Packer().put(Ask::kFacts).take());
    Unpacker from(answer);
    facts_.rows = from.get<std::uint64_t>();
    facts_.closed = from.get<bool>();
    facts_.cut_short = from.get<bool>();
    facts_.rows_dropped = from.get<std::uint64_t>();
    while (from.left() > 0) facts_.columns.push_back(from.text());
  }

  const RecordingFacts& facts() const override { return facts_; }
  std::string attribute(const std::string& column, const std::string& name) const override {
    return child_.ask(Packer().put(Ask::kAttribute).text(column).text(name).take());
  }
  std::vector<double> read(const std::string& column, std::size_t component) const override {
    return rows_from<double>(
        child_.ask(Packer().put(Ask::kColumn).text(column).put(std::uint64_t{component}).take()));
  }
  void read_samples(std::size_t first, std::span<Sample> samples) const override {
    const std::string answer = child_.ask(
        Packer().put(Ask::kSamples).put(std::uint64_t{first}).put(std::uint64_t{samples.size()}).take());
    if (!samples.empty()) {
      std::memcpy(static_cast<void*>(samples.data()), Unpacker(answer).raw(samples.size_bytes()).data(),
                  samples.size_bytes());
    }
  }
  std::vector<Event> events() const override {
    return rows_from<Event>(child_.ask(Packer().put(Ask::kEvents).take()));
  }
  std::vector<DatagramRow> datagrams() const override {
    return rows_from<DatagramRow>(child_.ask(Packer().put(Ask::kDatagrams).take()));
  }
  std::vector<MarkRow> marks() const override {
    return rows_from<MarkRow>(child_.ask(Packer().put(Ask::kMarks).take()));
  }
  std::vector<StatePieceRow> state_pieces() const override {
    return rows_from<StatePieceRow>(child_.ask(Packer().put(Ask::kStatePieces).take()));
  }
  std::vector<std::pair<std::string, std::string>> configuration() const override {
    const std::string answer = child_.ask(Packer().put(Ask::kConfiguration).take());
    Unpacker from(answer);
    std::vector<std::pair<std::string, std::string>> entries;
    while (from.left() > 0) {
      std::string name = from.text();
      entries.emplace_back(std::move(name), from.text());
    }
    return entries;
  }

 private:
  mutable ChildCall child_;
  RecordingFacts facts_;
};

}  // namespace

std::unique_ptr<RecordingSource> open_recording_isolated(const std::filesystem::path& path) {
  return std::make_unique<IsolatedSource>(path);
}

}  // namespace telenano::recording
