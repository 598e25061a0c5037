#include "base/error.h"
#include "cli/input_options.h"
#include "cli/read_progress.h"
#include "formats/path/path_file.h"
#include "report/recording_figure.h"

#include <filesystem>
#include <fmt/format.h>

namespace haptrace::cli {

Verb add_plot(CLI::App& app) {
  struct Arguments {
    std::string input, file;
    bool overwrite = false;
    CsvOptions csv;
  };
  const auto arguments = std::make_shared<Arguments>();
  CLI::App* verb = app.add_subcommand("plot", "plot a recording or a path: in space, deviation and force over time");
  verb->footer("  haptrace plot played.h5\n  haptrace plot played.h5 -o played.pdf");
  verb->add_option("file", arguments->input, "recording (HDF5) or path (CSV)")->type_name("FILE");
  verb->add_option("-o,--output", arguments->file,
                   "figure to write: .png, .svg or .pdf (default: FILE.png beside the input)")
      ->type_name("FILE");
  verb->add_flag("--overwrite", arguments->overwrite, "replace an existing file");
  add_input_options(*verb, arguments->csv);
  return {verb, [verb, arguments](const Output& output) {
            require(*verb, "file");
            const InputFile input(arguments->input, arguments->csv);
            if (input.passed_through() && arguments->file.empty())
              throw input_error(
                  fmt::format("haptrace plot {} needs -o, because the input has no file name", arguments->input));
            const std::filesystem::path name = input.name();
            const std::string file = arguments->file.empty()
                                         ? std::filesystem::path(name).replace_extension(".png").string()
                                         : arguments->file;
            keep_inputs(file, std::span(&arguments->input, 1));
            clean_up(output, file);
            const Figure figure = [&] {
              if (!is_hdf5(input.path()) || !arguments->csv.empty()) {
                const Path path = load_path(input.path(), input.csv());
                for (const std::string& note : path.notes) output.remark(note);
                return figure_of(path);
              }
              const RecordingReader reader(input.path());
              ReadProgress progress(output, input.name(), reader.rows());
              return figure_of(reader, name.filename().string(), progress.callback());
            }();
            save_figure(figure, file, arguments->overwrite);
            output.tell({{"file", file}}, fmt::format("{}\n", file));
            return kDone;
          }};
}

}  // namespace haptrace::cli
