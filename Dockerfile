# docker build -t everystate . && docker run --rm -v "$PWD/runs:/everystate/runs" everystate
FROM debian:bookworm-slim
RUN apt-get update \
    && apt-get install -y --no-install-recommends python3.11-venv make libegl1 libgl1-mesa-dri \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /everystate
COPY . .
RUN make setup
CMD ["make", "demo"]
