#include "base/error.h"
#include "base/text_file.h"
#include "cli/input_options.h"
#include "cli/path_options.h"
#include "cli/read_progress.h"
#include "cli/verb.h"
#include "formats/convert/anonymise.h"
#include "formats/convert/change_place.h"
#include "formats/convert/resample.h"
#include "formats/recording/recording_stream.h"
#include "formats/recording/sampling.h"
#include "formats/recording/storage_report.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fmt/format.h>
#include <optional>
#include <utility>

namespace haptrace::cli {
namespace {

namespace fs = std::filesystem;

constexpr int kCompress = 6;  // deflate level if none is given

struct ConvertArguments {
  std::string input, file;
  bool overwrite = false;
  double from = -std::numeric_limits<double>::infinity(), to = std::numeric_limits<double>::infinity();
  double resample_hz = 0, max_gap = 0;
  std::optional<double> low_pass_hz;
  std::string method = "cubic";
  bool anonymise = false, dejitter = false, partial = false;
  int digits = 0, compress = 0;
  std::string libver = "1.10", precision;
  std::vector<std::string> streams, map;
  CsvOptions csv;
  ChangeArguments place;

  [[nodiscard]] bool to_standard_output() const { return file == "-"; }
};

/// The chain of sample sources, and pointers to those that report.
struct Pipeline {
  std::unique_ptr<RecordingSource> source;
  std::shared_ptr<SamplingReport> sampling = std::make_shared<SamplingReport>();
  const ResampledSource* resampled = nullptr;
  const AnonymisedSource* anonymised = nullptr;
};

SourceOptions source_options(const ConvertArguments& arguments, const CsvOptions& csv) {
  SourceOptions options;
  options.csv = csv;
  options.any_order = arguments.resample_hz != 0;
  options.parts = parts_of(arguments.partial);
  options.streams = arguments.streams;
  options.dejitter = arguments.dejitter;
  for (const std::string& entry : arguments.map) {
    const std::size_t equals = entry.find('=');
    if (equals == std::string::npos)
      throw input_error(fmt::format("--map {} must be COLUMN=LABEL, for example x=PosX", entry));
    options.channels[entry.substr(0, equals)] = entry.substr(equals + 1);
  }
  return options;
}

/// Returns the samples of the input that are converted.
std::unique_ptr<RecordingSource> open_samples(const ConvertArguments& arguments, const InputFile& input) {
  auto source = open_source(input.path(), source_options(arguments, input.csv()));
  if (std::isfinite(arguments.from) || std::isfinite(arguments.to))
    source = cut(std::move(source), arguments.from, arguments.to);
  return source;
}

/// Moves the samples to the place that the options ask for. The frame comes last: it brings a recording from the
/// device's coordinates to the world's, so that `play --frame` brings it back. Reads all samples once if the fixed
/// point depends on them.
std::unique_ptr<RecordingSource> in_place(std::unique_ptr<RecordingSource> source, const ConvertArguments& arguments,
                                          const InputFile& input) {
  PathChange change = arguments.place.change();
  const std::optional<DeviceFrame> frame = std::exchange(change.frame, std::nullopt);
  if (change.is_identity() && !frame) return source;
  Vec3 first = Vec3::Zero();
  Box bounds;
  if (change.about.kind == ChangeCentre::Kind::start || change.about.kind == ChangeCentre::Kind::centre) {
    const auto samples = open_samples(arguments, input);
    bool begun = false;
    for (auto block = samples->next(); !block.empty(); block = samples->next())
      for (const Sample& sample : block) {
        if (!is_finite(sample.position)) continue;
        if (!std::exchange(begun, true)) first = sample.position;
        bounds.include(sample.position);
      }
  }
  if (bounds.min.x() > bounds.max.x()) bounds = {first, first};
  Similarity similarity = change.of(first, bounds);
  std::string text = describe(change);
  if (frame) {
    similarity = to_device(*frame).inverse() * similarity;
    text += std::string(text.empty() ? "" : ", ") + "brought from the device's to the world's coordinates";
  }
  return change_place(std::move(source), similarity, text);
}

Pipeline open_pipeline(const ConvertArguments& arguments, const InputFile& input) {
  Pipeline pipeline;
  pipeline.source = in_place(open_samples(arguments, input), arguments, input);
  pipeline.source = observe(std::move(pipeline.source), [sampling = pipeline.sampling](std::span<const Sample> block) {
    for (const Sample& sample : block) sampling->add(sample);
  });
  if (arguments.resample_hz != 0) {
    auto resampled = resample(std::move(pipeline.source), {.rate_hz = arguments.resample_hz,
                                                           .method = parse_interpolation(arguments.method),
                                                           .max_gap = arguments.max_gap,
                                                           .low_pass_hz = arguments.low_pass_hz});
    pipeline.resampled = resampled.get();
    pipeline.source = std::move(resampled);
  }
  if (arguments.anonymise) {
    auto anonymised = anonymise(std::move(pipeline.source));
    pipeline.anonymised = anonymised.get();
    pipeline.source = std::move(anonymised);
  }
  return pipeline;
}

SinkOptions sink_options(const ConvertArguments& arguments) {
  SinkOptions options;
  options.overwrite = arguments.overwrite;
  options.digits = arguments.digits;
  if (arguments.digits < 0 || arguments.digits > 17)
    throw input_error(
        fmt::format("--digits {} must be 1 to 17, or 0 for as many digits as restore every number", arguments.digits));
  if (arguments.libver != "1.8" && arguments.libver != "1.10")
    throw input_error(
        fmt::format("--libver {} must be 1.10 or, for readers such as MATLAB before R2021b, 1.8", arguments.libver));
  options.hdf5.for_hdf5_1_8 = arguments.libver == "1.8";
  options.hdf5.storage.deflate = arguments.compress;
  options.hdf5.storage.precision = parse_precision(arguments.precision);
  // Only whole chunks are packed: small chunks make short files smaller, and long files hardly larger.
  if (options.hdf5.storage.filtered()) options.hdf5.storage.rows_per_chunk = 1024;
  return options;
}

nlohmann::json to_json(const ResampleReport& report) {
  return {{"rows_in", report.rows_in},
          {"rows_out", report.rows_out},
          {"duplicates", report.duplicates},
          {"backward", report.backward},
          {"without_position", report.without_position},
          {"gaps", report.gaps},
          {"longest_gap_s", report.longest_gap},
          {"max_gap_s", report.max_gap},
          {"low_pass_hz", report.low_pass_hz},
          {"rms_difference_m", report.rms_difference},
          {"max_difference_m", report.max_difference},
          {"compared", report.compared}};
}

nlohmann::json to_json(const AnonymiseReport& report) {
  return {{"dropped", report.dropped}, {"kept", report.kept}, {"event_texts", report.texts}};
}

nlohmann::json to_json(const std::vector<StoredColumn>& columns) {
  nlohmann::json list = nlohmann::json::array();
  for (const StoredColumn& column : columns)
    list.push_back({{"name", column.name},
                    {"units", column.units},
                    {"raw_bytes", column.raw_bytes},
                    {"stored_bytes", column.stored_bytes},
                    {"bytes_per_hour", column.bytes_per_hour},
                    {"rms_loss", column.rms_loss},
                    {"max_loss", column.max_loss}});
  return list;
}

std::string text_of(const AnonymiseReport& report) {
  std::string text =
      fmt::format("  dropped: {}\n", report.dropped.empty() ? "nothing, since none of these fields was present"
                                                            : fmt::format("{}", fmt::join(report.dropped, ", ")));
  if (report.texts > 0) text += fmt::format("  dropped: the texts of {} events\n", report.texts);
  if (!report.kept.empty())
    text += fmt::format("  kept, and may still identify the participant or the date: {}, and the movement itself\n",
                        fmt::join(report.kept, ", "));
  return text;
}

std::string text_of(const std::vector<StoredColumn>& columns) {
  std::string text = fmt::format("  {:<20} {:>12} {:>12} {:>12}  {:>10} {:>10}\n", "column", "bytes", "stored",
                                 "MB per hour", "rms loss", "max loss");
  for (const StoredColumn& column : columns)
    text += fmt::format("  {:<20} {:>12} {:>12} {:>12.3f}  {:>10.3g} {:>10.3g} {}\n", column.name, column.raw_bytes,
                        column.stored_bytes, 1e-6 * column.bytes_per_hour, column.rms_loss, column.max_loss,
                        column.units == "1" ? "" : column.units);
  return text;
}

/// What is reported of a conversion: to programs, and to people.
struct ConvertReport {
  nlohmann::json json;
  std::string text;
};

/// Reports how much was converted.
ConvertReport report_sizes(const ConvertArguments& arguments, const InputFile& input, std::uint64_t rows,
                           const Sampling& sampling) {
  std::error_code ignored;
  const auto bytes_in = fs::file_size(input.path(), ignored);
  const auto bytes_out = arguments.to_standard_output() ? 0 : fs::file_size(arguments.file, ignored);
  return {{{"input", arguments.input},
           {"file", arguments.file},
           {"samples", rows},
           {"bytes_in", bytes_in},
           {"bytes", bytes_out},
           {"sampling", json_of(sampling)}},
          arguments.to_standard_output()
              ? fmt::format("{} samples\n", rows)
              : fmt::format("{}: {} samples, {:.3f} MB from {:.3f} MB\n", arguments.file, rows,
                            1e-6 * static_cast<double>(bytes_out), 1e-6 * static_cast<double>(bytes_in))};
}

/// Reports what was resampled and what was removed.
void add_changes(const Pipeline& pipeline, const ConvertArguments& arguments, ConvertReport& report) {
  if (pipeline.resampled != nullptr) {
    const ResampleReport& resampled = pipeline.resampled->report();
    report.json["resample"] = to_json(resampled);
    report.text += fmt::format(
        "  {} samples at {:g} Hz from {} samples; they differ from {} by {:.3g} mm rms, {:.3g} mm at most\n",
        resampled.rows_out, arguments.resample_hz, resampled.rows_in,
        resampled.low_pass_hz > 0 ? "the unfiltered samples" : "the original samples", 1e3 * resampled.rms_difference,
        1e3 * resampled.max_difference);
  }
  if (pipeline.anonymised != nullptr) {
    report.json["anonymised"] = to_json(pipeline.anonymised->report());
    report.text += text_of(pipeline.anonymised->report());
  }
}

/// Reports the size and the loss of every column in the file. Reads the input and the file once more.
void add_columns(const ConvertArguments& arguments, const InputFile& input, const Output& output,
                 ConvertReport& report) {
  ReadProgress progress(output, "reading back " + arguments.file);
  Pipeline again = open_pipeline(arguments, input);
  const RecordingSource& original = *again.source;
  again.source =
      observe(std::move(again.source), [&](std::span<const Sample>) { progress.tell_share(original.fraction()); });
  const std::vector<StoredColumn> columns = report_storage(arguments.file, *again.source);
  report.json["columns"] = to_json(columns);
  report.text += text_of(columns);
}

/// Returns what the user should know about the samples and the format.
std::vector<std::string> remarks_on(const Pipeline& pipeline, const Sampling& sampling, const std::string& file) {
  std::vector<std::string> remarks = pipeline.source->notes();
  const std::string ending = file_ending(file);
  if (pipeline.source->columns().contacts && ending != ".h5" && ending != ".hdf5")
    remarks.emplace_back("the contacts with the scene were left out: text formats have no place for them");
  const bool csv = ending != ".h5" && ending != ".hdf5" && ending != ".jsonl";
  if (csv && pipeline.source->columns().support)
    remarks.emplace_back(
        "the force holds the support of the arm, which the columns sx, sy, sz state: guide leaves it out of an HDF5 "
        "recording, but replays it from CSV");
  for (std::string& note : notes(sampling, pipeline.resampled == nullptr)) remarks.push_back(std::move(note));
  return remarks;
}

int convert(const ConvertArguments& arguments, const InputFile& input, const Output& output) {
  SinkOptions options = sink_options(arguments);
  if (arguments.to_standard_output() && output.json)
    throw input_error("-o - and --json both write to standard output; leave one of them out");
  const Signals signals;
  const auto stopped = [&] { return signals.stop().count() > 0; };
  const auto interrupted = [&] {
    output.remark(arguments.to_standard_output() ? "interrupted; the output is incomplete"
                                                 : "interrupted; nothing was written");
    return kInterrupted;
  };

  Pipeline pipeline = open_pipeline(arguments, input);
  RecordingSource& source = *pipeline.source;
  std::uint64_t rows = 0;
  {
    ReadProgress progress(output, "writing " + arguments.file);
    options.clocks = source.clocks();
    const auto sink = create_sink(arguments.file, source.header(), source.columns(), source.events(), options);
    rows = copy(source, *sink, {.report = progress.share_callback(), .stopped = stopped});
    if (stopped()) return interrupted();
    sink->finish();
  }

  const Sampling sampling = pipeline.sampling->result();
  const std::vector<std::string> remarks = remarks_on(pipeline, sampling, arguments.file);
  ConvertReport report = report_sizes(arguments, input, rows, sampling);
  add_changes(pipeline, arguments, report);
  if (options.hdf5.storage.filtered() && !arguments.to_standard_output() && is_hdf5(arguments.file))
    add_columns(arguments, input, output, report);
  report.json["notes"] = remarks;
  for (const std::string& remark : remarks) output.remark(remark);
  if (arguments.to_standard_output())
    output.remark(report.text.substr(0, report.text.size() - 1));  // standard output contains the samples
  else
    output.tell(report.json, report.text);
  return kDone;
}

void add_sample_options(CLI::App& verb, ConvertArguments& arguments) {
  verb.add_option("--from", arguments.from, "drop samples before this time [s]")->group("Samples");
  verb.add_option("--to", arguments.to, "drop samples after this time [s]")->group("Samples");
  verb.add_option("--resample", arguments.resample_hz, "resample to this rate [Hz]; gaps are kept")->group("Samples");
  verb.add_option("--method", arguments.method, "interpolation of --resample: hold | linear | cubic | quintic")
      ->capture_default_str()
      ->group("Samples");
  verb.add_option("--max-gap", arguments.max_gap, "longest gap that --resample interpolates [s] (0: 20 median steps)")
      ->capture_default_str()
      ->group("Samples");
  verb.add_option(
          "--low-pass", arguments.low_pass_hz,
          "cut-off of the low-pass filter before --resample [Hz] (0: none; default: rate / 2.4 if the rate is lowered)")
      ->group("Samples");
}

void add_storage_options(CLI::App& verb, ConvertArguments& arguments) {
  verb.add_option("--digits", arguments.digits,
                  "significant digits in CSV and JSON lines (0: as many as needed to restore every number)")
      ->capture_default_str()
      ->group("Storage");
  verb.add_option("--compress", arguments.compress, "HDF5: deflate level, 0 (none) to 9 (without a value: 6)")
      ->expected(0, 1)
      ->group("Storage");
  verb.add_option("--precision", arguments.precision,
                  "HDF5: largest rounding errors, as in 1um,1mN; the losses are reported")
      ->group("Storage");
  verb.add_option("--libver", arguments.libver, "HDF5: 1.10, or 1.8 for older readers (MATLAB before R2021b)")
      ->capture_default_str()
      ->group("Storage");
}

void add_xdf_options(CLI::App& verb, ConvertArguments& arguments) {
  verb.add_option("--stream", arguments.streams,
                  "XDF: name or type of a stream; the samples have the first one's times")
      ->take_all()
      ->expected(1)
      ->group("XDF");
  verb.add_option("--map", arguments.map, "XDF: channel labels of the columns, as in x=PosX,fz=Fz")
      ->delimiter(',')
      ->group("XDF");
  verb.add_flag("--dejitter", arguments.dejitter, "XDF: replace the time stamps by evenly spaced ones fitted to them")
      ->group("XDF");
}

/// Runs the verb and returns its exit code.
int convert_command(const CLI::App& verb, ConvertArguments& arguments, const Output& output) {
  require(verb, "file");
  const bool resamples = arguments.resample_hz != 0;
  refuse_useless(verb, std::to_array<Dependence>({{"--method", resamples, "--resample"},
                                                  {"--max-gap", resamples, "--resample"},
                                                  {"--low-pass", resamples, "--resample"}}));
  if (const auto& level = verb.get_option("--compress")->results(); level.size() == 1 && level[0].empty())
    arguments.compress = kCompress;
  const InputFile input(arguments.input, arguments.csv);
  if (input.passed_through() && arguments.file.empty())
    throw input_error(
        fmt::format("haptrace convert {} needs -o, because the input has no file name; "
                    "-o - writes CSV to standard output",
                    arguments.input));
  if (arguments.file.empty()) {
    const bool hdf5 = is_hdf5(input.path());
    arguments.file = fs::path(arguments.input).replace_extension(hdf5 ? ".csv" : ".h5").string();
  }
  keep_inputs(arguments.file, std::span(&arguments.input, 1));
  clean_up(output, arguments.file);
  return convert(arguments, input, output);
}

}  // namespace

Verb add_convert(CLI::App& app) {
  const auto arguments = std::make_shared<ConvertArguments>();
  ConvertArguments& a = *arguments;
  CLI::App* verb = app.add_subcommand("convert", "convert the format, size or time base of a recording");
  verb->footer(
      "Reads HDF5, CSV, JSON lines (.jsonl) and XDF (Lab Streaming Layer); writes .h5, .csv and .jsonl. By default,\n"
      "convert changes no data, except that it low-pass filters them before it lowers the rate. It reports\n"
      "irregular time stamps and channels, recognises the headers, units and time stamps of other programs' CSV\n"
      "files, and prints its assumptions. As FILE, - is standard input; as -o, it is standard output (CSV).\n"
      "  haptrace convert a.h5 -o a.csv\n"
      "  haptrace convert excel.csv -o excel.h5 --columns t=Zeit,x=Weg --units mm,ms\n"
      "  haptrace convert - -o - < motive.csv > path.csv\n"
      "  haptrace convert log.csv -o log.h5 --resample 1000 --method cubic\n"
      "  haptrace convert lab.xdf -o lab.h5 --stream Hand --stream Force --map x=PosX,y=PosY,z=PosZ\n"
      "  haptrace convert a.h5 -o shared.h5 --anonymise --precision 1um,1mN --compress 6");
  verb->add_option("file", a.input, "recording or path (-: standard input)")->type_name("FILE");
  verb->add_option(
          "-o,--output", a.file,
          "file to write (-: CSV on standard output; default: the input's name with .h5, or .csv if it is HDF5)")
      ->type_name("FILE");
  verb->add_flag("--overwrite", a.overwrite, "replace an existing file");
  add_partial(*verb, a.partial);
  add_input_options(*verb, a.csv);
  add_sample_options(*verb, a);
  a.place.add_to(*verb, "Place");
  a.place.add_frame_to(
      *verb, "Place",
      "the device's pose in the world: brings a recording from the device's coordinates to the world's");
  verb->add_flag("--anonymise", a.anonymise,
                 "remove subject, operator, notes, serial numbers, metadata, file names and mark texts")
      ->group("Samples");
  add_storage_options(*verb, a);
  add_xdf_options(*verb, a);
  return {verb, [verb, arguments](const Output& output) { return convert_command(*verb, *arguments, output); }};
}

}  // namespace haptrace::cli
