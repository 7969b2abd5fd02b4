// Sorts a table by the column whose head is clicked; without script the tables stand in their own order.
(function () {
  "use strict";
  function key(row, column) {
    var text = row.cells[column].textContent.trim().replace(/\u2212/g, "-");
    var number = parseFloat(text.replace(/^[^\d.-]+/, "").replace(/(\d),(?=\d{3})/g, "$1"));
    return { text: text, number: number };
  }
  function compare(a, b) {
    if (isNaN(a.number) !== isNaN(b.number)) return isNaN(a.number) ? 1 : -1;
    return isNaN(a.number) ? a.text.localeCompare(b.text) : a.number - b.number || a.text.localeCompare(b.text);
  }
  function sort(head) {
    var body = head.closest("table").tBodies[0];
    var down = head.getAttribute("aria-sort") === "ascending";
    var rows = Array.from(body.rows).map(function (row) { return [key(row, head.cellIndex), row]; });
    rows.sort(function (a, b) { return (down ? -1 : 1) * compare(a[0], b[0]); });
    rows.forEach(function (pair) { body.appendChild(pair[1]); });
    Array.from(head.parentNode.cells).forEach(function (cell) { cell.removeAttribute("aria-sort"); });
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
  }
  document.querySelectorAll("table.sortable").forEach(function (table) {
    if (table.tBodies.length !== 1 || table.tBodies[0].rows.length < 2) return;
    Array.from(table.tHead.rows[0].cells).forEach(function (head) {
      head.tabIndex = 0;
      head.classList.add("sorts");
      head.addEventListener("click", function () { sort(head); });
      head.addEventListener("keydown", function (event) {
        if (event.key === "Enter" || event.key === " ") { event.preventDefault(); sort(head); }
      });
    });
  });
  function open() {  // a link to a folded section opens it
    var target = location.hash.length > 1 && document.getElementById(location.hash.slice(1));
    var fold = target && (target.closest("details") || target.querySelector("details"));
    if (fold) fold.open = true;
  }
  function alone(svg) {  // an SVG file: with the colours of print, and the font that its letters were placed for
    var text = new XMLSerializer().serializeToString(svg);
    text = text.replace(/var\(--[\w-]+, (#[0-9a-f]{6})\)/g, "$1").replace(/ (role|aria-label)="[^"]*"/g, "");
    return text.replace("<svg", '<svg font-family="DejaVu Sans, Verdana, sans-serif"');
  }
  function save(address, name) {
    var link = document.createElement("a");
    link.href = address;
    link.download = name;
    link.click();
  }
  function asAddress(svg) {
    return "data:image/svg+xml;charset=utf-8," + encodeURIComponent(alone(svg));
  }
  function savePng(svg, name) {
    var picture = new Image(), box = svg.viewBox.baseVal, scale = 1800 / box.width;
    picture.onload = function () {
      var canvas = document.createElement("canvas"), paper = canvas.getContext("2d");
      canvas.width = scale * box.width;
      canvas.height = scale * box.height;
      paper.fillStyle = "white";
      paper.fillRect(0, 0, canvas.width, canvas.height);
      paper.drawImage(picture, 0, 0, canvas.width, canvas.height);
      save(canvas.toDataURL("image/png"), name);
    };
    picture.src = asAddress(svg);
  }
  document.querySelectorAll("figure a.data[download]").forEach(function (link) {
    var svg = link.closest("figure").querySelector("svg"), name = link.download.replace(/\.csv$/, "");
    if (!svg) return;
    ["SVG", "PNG"].forEach(function (kind) {
      var button = document.createElement("button");
      button.type = "button";
      button.className = "data";
      button.textContent = kind;
      button.setAttribute("aria-label", "Save this figure as " + kind);
      button.addEventListener("click", function () {
        if (kind === "PNG") savePng(svg, name + ".png");
        else save(asAddress(svg), name + ".svg");
      });
      link.parentNode.append(" ", button);
    });
  });
  window.addEventListener("hashchange", open);
  open();
})();
