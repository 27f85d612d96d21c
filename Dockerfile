# One image for encoder, decoder and relay: docker compose up
FROM python:3.11-slim-bookworm

# EGL in software; the same packages as scripts/system_libraries.sh installs.
RUN apt-get update \
    && apt-get install -y --no-install-recommends libegl1 libgl1 libegl-mesa0 libgl1-mesa-dri \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /opt/risorius
COPY requirements.lock ./
# What only tests and checks need does not stay.
RUN pip install --no-cache-dir --require-hashes --no-deps -r requirements.lock \
    && pip uninstall --yes check-jsonschema coverage hypothesis matplotlib mypy pytest pytest-cov \
    pytest-xdist ruff types-pyserial types-pyyaml
COPY pyproject.toml README.md LICENSE ./
COPY runtime ./runtime
COPY shared_model ./shared_model
COPY protocol ./protocol
COPY encoder ./encoder
COPY decoder ./decoder
COPY aam ./aam
COPY loopback ./loopback
COPY player ./player
COPY risorius ./risorius
RUN pip install --no-cache-dir --no-deps --no-build-isolation .

# A new volume belongs to whom its folder belongs to here.
RUN useradd --create-home risorius && install -d -o risorius /out /keys /home/risorius/.cache
USER risorius
# Compiled loops are kept in the home of whom they are compiled for.
RUN risorius compile
ENTRYPOINT ["risorius"]
