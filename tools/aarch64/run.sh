#!/bin/bash
# The core for aarch64, compiled here, run by an emulator: a part of its own tests, then the numbers of
# core and planner beside those of this machine. For Debian 12, from the tree: `make aarch64`.
set -euo pipefail
here=$PWD python=$PWD/.venv/bin/python work=$PWD/build/aarch64
for tool in aarch64-linux-gnu-g++ qemu-aarch64-static; do
    command -v "$tool" > /dev/null || {
        echo "$tool is needed (Debian: g++-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user-static)" >&2
        exit 1
    }
done

# Debian's Python for arm64, unpacked beside the machine's own, which stays as it is.
if [ ! -f "$work/root/complete" ]; then
    mkdir -p "$work"/{apt/state/lists/partial,apt/cache/archives/partial,debs,root}
    of_arm64=(-o APT::Architecture=arm64 -o APT::Architectures::=arm64 -o Dir::State="$work/apt/state"
        -o Dir::Cache="$work/apt/cache" -o Dir::State::status=/dev/null)
    apt-get "${of_arm64[@]}" --quiet update
    (cd "$work/debs" && apt-get "${of_arm64[@]}" --quiet download python3.11-minimal libpython3.11-minimal \
        libpython3.11-stdlib libpython3.11-dev libc6 libstdc++6 libgcc-s1 libgomp1 zlib1g libexpat1 \
        libssl3 libffi8 libbz2-1.0 liblzma5 libsqlite3-0 libuuid1 libcrypt1)
    for package in "$work"/debs/*.deb; do dpkg -x "$package" "$work/root"; done
    touch "$work/root/complete"
fi
if [ ! -f "$work/site/complete" ]; then
    .venv/bin/uv pip install --quiet --python-version 3.11 --python-platform aarch64-manylinux_2_28 \
        --only-binary :all: --constraint constraints.txt --target "$work/site" \
        numpy scipy pin piqp pyyaml lz4 zstandard mcap rosbags plotly matplotlib pytest pytest-xdist
    touch "$work/site/complete"
fi

# With the flags of setup.py, and beside the core of this machine: each Python takes its own.
CC=aarch64-linux-gnu-gcc CXX=aarch64-linux-gnu-g++ LDSHARED='aarch64-linux-gnu-g++ -shared' \
    LDCXXSHARED='aarch64-linux-gnu-g++ -shared' SETUPTOOLS_EXT_SUFFIX=.cpython-311-aarch64-linux-gnu.so \
    CPPFLAGS="-I$work/root/usr/include/python3.11 -I$work/root/usr/include" \
    "$python" setup.py --quiet build_ext --inplace --build-temp "$work/objects"

emulated() {
    env OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE=1 \
        PYTHONPATH="$here:$here/test:$here/tools:$work/site:$work/site/cmeel.prefix/lib/python3.11/site-packages" \
        qemu-aarch64-static -L "$work/root" "$work/root/usr/bin/python3.11" "$@"
}
emulated -m pytest -p no:cacheprovider -c "$here/pyproject.toml" --rootdir "$here" -o addopts= -p tiers \
    -W ignore -q -k "${AARCH64_TESTS:-border or driven or times}" "$here"/test/test_core_{border,driven_motion,times}.py
emulated "$here/tools/aarch64/sample.py" write "$work/theirs.npz"
OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 PYTHONPATH="$here/test" \
    "$python" tools/aarch64/sample.py write "$work/ours.npz"
"$python" tools/aarch64/sample.py compare "$work/ours.npz" "$work/theirs.npz"
