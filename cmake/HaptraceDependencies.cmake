# What the libraries need, for the build and for programs that use the installed package.
find_package(Threads REQUIRED)
find_package(Eigen3 3.4 REQUIRED NO_MODULE)
find_package(fmt 9 REQUIRED)
find_package(nlohmann_json 3.11 REQUIRED)
find_package(Boost 1.74 REQUIRED)
find_package(PkgConfig REQUIRED)
pkg_check_modules(HDF5 REQUIRED IMPORTED_TARGET hdf5>=1.10.8)
pkg_check_modules(CAIRO REQUIRED IMPORTED_TARGET cairo>=1.16)
