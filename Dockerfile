# pyibr on Debian's PoCL, with its kernels built: docker build -t pyibr . && docker run --rm pyibr doctor
FROM python:3.13-slim-trixie

RUN apt-get update \
    && apt-get install -y --no-install-recommends pocl-opencl-icd \
    && rm -rf /var/lib/apt/lists/*

COPY . /src
RUN pip install --no-cache-dir '/src[exr,hdf5]' && rm -rf /src

# Both caches are part of the image, and its users may write there.
ENV PYIBR_CACHE=/var/cache/pyibr POCL_CACHE_DIR=/var/cache/pocl
RUN useradd --create-home pyibr \
    && mkdir -p "$PYIBR_CACHE" "$POCL_CACHE_DIR" /work \
    && chown pyibr "$PYIBR_CACHE" "$POCL_CACHE_DIR" /work
USER pyibr
RUN pyibr doctor --build

WORKDIR /work
ENTRYPOINT ["pyibr"]
CMD ["--help"]
